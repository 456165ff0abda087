// Newton's method on general blocks in each of its metrics, and which is chosen.

#include <cmath>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/metrics.hpp>
#include <rotavg/anisotropic/newton.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Precisions whose eigenvalues are in the ratio 1 : 2 : `largest`, about axes at random, and
/// measurements whose noise has them.
AnisotropicGraph graph_of(Random& random, const test::Pairs& pairs, double largest) {
  const Rotations truth = random.rotations(test::num_nodes(pairs));
  std::vector<RelativeRotation> measurements;
  std::vector<Matrix3> precisions;
  for (const auto& [i, j] : pairs) {
    const Matrix3 V = random.rotation();
    const Vector3 H(1e3, 2e3, largest * 1e3);
    const Vector3 e = V * (0.3 * random.rotation().col(0)).cwiseQuotient(H.cwiseSqrt());
    const auto& R_i = truth[static_cast<std::size_t>(i)];
    const auto& R_j = truth[static_cast<std::size_t>(j)];
    measurements.push_back({i, j, R_i.transpose() * R_j * exp_so3(e)});
    precisions.push_back(symmetric_part(Matrix3(V * H.asDiagonal() * V.transpose())));
  }
  return {MeasurementGraph(measurements), precisions};
}

/// A lattice of side^3 nodes.
test::Pairs lattice(Index side) {
  test::Pairs pairs;
  const auto node = [side](Index x, Index y, Index z) { return (x * side + y) * side + z; };
  for (Index x = 0; x < side; ++x) {
    for (Index y = 0; y < side; ++y) {
      for (Index z = 0; z < side; ++z) {
        if (x + 1 < side) pairs.emplace_back(node(x, y, z), node(x + 1, y, z));
        if (y + 1 < side) pairs.emplace_back(node(x, y, z), node(x, y + 1, z));
        if (z + 1 < side) pairs.emplace_back(node(x, y, z), node(x, y, z + 1));
      }
    }
  }
  return pairs;
}

}  // namespace

TEST_CASE("Newton's method comes to the same optimum in every metric") {
  Random random;
  for (const double largest : {2.0, 10.0, 100.0}) {
    const AnisotropicGraph graph = graph_of(random, lattice(5), largest);
    const Components components = connected_components(graph.scalar());
    auto eliminations = grounded_eliminations(graph.scalar(), components);
    const Rotations start(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
    IterationOptions first;
    first.max_iterations = 30;
    const Rotations swept = bcd(graph, start, first).rotations;
    std::vector<IterationResult> results;
    for (const auto kind : {MetricKind::blocks, MetricKind::scalar, MetricKind::diagonal}) {
      IterationOptions options;
      options.num_threads = static_cast<int>(results.size()) + 1;
      results.push_back(newton(graph, swept, eliminations, kind, options));
      CHECK(is_converged(results.back().status));
      CHECK(results.back().objective == doctest::Approx(results.front().objective).epsilon(1e-12));
    }
    // Where the axes are known nearly alike the scalar one is nearly as good.
    if (largest == 2.0) CHECK(results[1].iterations <= results[0].iterations + 2);
  }
}

TEST_CASE("a metric has the same bits for any number of threads") {
  Random random;
  const AnisotropicGraph graph = graph_of(random, lattice(12), 3.0);
  const Components components = connected_components(graph.scalar());
  const Rotations start(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  for (const auto kind : {MetricKind::blocks, MetricKind::scalar, MetricKind::diagonal}) {
    std::vector<double> objectives;
    for (const int num_threads : {1, 2, 5}) {
      auto eliminations = grounded_eliminations(graph.scalar(), components, num_threads);
      IterationOptions options;
      options.num_threads = num_threads;
      options.max_iterations = 3;
      objectives.push_back(newton(graph, start, eliminations, kind, options).objective);
    }
    CHECK(objectives[1] == objectives[0]);
    CHECK(objectives[2] == objectives[0]);
  }
}

TEST_CASE("the metric is chosen by what it takes") {
  Random random;
  const auto kind_of = [&](const test::Pairs& pairs, double largest) {
    const AnisotropicGraph graph = graph_of(random, pairs, largest);
    const Components components = connected_components(graph.scalar());
    auto eliminations = grounded_eliminations(graph.scalar(), components);
    CHECK(graph.unevenness() == doctest::Approx(std::sqrt(largest)));
    return metric_kind(graph, eliminations);
  };
  // Three-dimensional lattices fill in, trajectories do not.
  CHECK(kind_of(lattice(15), 2.5) == MetricKind::scalar);
  CHECK(kind_of(test::cycle(2000), 10.0) == MetricKind::blocks);
}

TEST_CASE("nodes without edges stay where they are in the diagonal metric") {
  Random random;
  const std::vector<RelativeRotation> measurements{{0, 1, random.rotation()},
                                                   {1, 2, random.rotation()}};
  const MeasurementGraph graph(measurements, {0, 1, 2, 3});
  const AnisotropicGraph anisotropic(graph, {Matrix3::Identity(), Matrix3::Identity()});
  auto eliminations = grounded_eliminations(graph, connected_components(graph));
  const Rotations start = random.rotations(4);
  const auto result = newton(anisotropic, start, eliminations, MetricKind::diagonal);
  CHECK(is_converged(result.status));
  CHECK(result.objective < 1e-20);
  CHECK(result.rotations[3] == start[3]);
}

#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Cholesky>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

std::optional<Rotations> chordal(const MeasurementGraph& graph, double max_flops = 5e10,
                                 const std::function<bool()>& keep_going = {}) {
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  return chordal_init(graph, eliminations, max_flops, keep_going);
}

}  // namespace

TEST_CASE("the chordal start is exact without noise, in every component") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    auto edges = test::simulate(random, test::random_connected(random, 12, 10), 0.0);
    for (RelativeRotation m : test::simulate(random, test::random_connected(random, 5, 3), 0.0)) {
      m.i += 100;
      m.j += 100;
      edges.push_back(m);
    }
    test::spread_weights(random, 2.0, edges);
    const MeasurementGraph graph(edges);
    const auto R = chordal(graph);
    REQUIRE(R.has_value());
    CHECK(objective(graph, *R) <= 1e-20 * graph.total_weight());
  }
}

TEST_CASE("before the projection the chordal start minimises (3) over free matrices") {
  // One cycle of three whose measurements do not close: the free minimiser is known from the dense
  // connection Laplacian.
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const MeasurementGraph graph = test::simulate_graph(random, test::complete(6), 0.5);
    const Index n = graph.num_nodes();
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(3 * n, 3 * n);
    for (Index i = 0; i < n; ++i) {
      A.block<3, 3>(3 * i, 3 * i) = graph.degree(i) * Matrix3::Identity();
      for (const HalfEdge& h : graph.row(i)) A.block<3, 3>(3 * i, 3 * h.node) -= graph.block(h);
    }
    const Eigen::Index free = 3 * (n - 1);
    const Eigen::MatrixXd X =
        A.bottomRightCorner(free, free).llt().solve(-A.bottomLeftCorner(free, 3));
    const auto R = chordal(graph);
    REQUIRE(R.has_value());
    for (Index i = 1; i < n; ++i) {
      const Matrix3 expected = nearest_rotation(X.middleRows<3>(3 * (i - 1)).transpose());
      CHECK(((*R)[i] - expected).norm() < 1e-12);
    }
  }
}

TEST_CASE("where the chordal start costs too much or is stopped, there is none") {
  Random random;
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(6), 0.5);
  CHECK(!chordal(graph, 0.0).has_value());
  CHECK(!chordal(graph, 1e9, [] { return false; }).has_value());
  SolveOptions options;
  options.init = Initialization::chordal;
  options.certificate.max_factorization_flops = 0.0;
  CHECK(solve(graph, options).init == Initialization::shortest_path);
}

TEST_CASE("where everything is left to choose, a bad start is followed by the chordal one") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 30; ++k) {
    const MeasurementGraph graph =
        test::simulate_graph(random, test::grid(6, 6), 1.2);  // paths are short
    SolveOptions options;
    options.max_rank = 0;  // and no staircase after them
    const Solution best = solve(graph, options);
    options.init = Initialization::shortest_path;
    const Solution first = solve(graph, options);
    const auto says = [&](const char* what) { return best.reason.find(what) != std::string::npos; };
    const bool ran_twice = says("a second run, from the chordal start");
    const bool wandered = says("newton wandered, and began anew: newton");
    if (wandered) {
      CHECK(best.init == Initialization::chordal);
    } else {
      CHECK(best.objective <= first.objective * (1.0 + 1e-9));
    }
    if (first.certificate.verdict == Verdict::not_certified) {
      CHECK(ran_twice != wandered);
    } else {
      CHECK(!ran_twice);
    }
  }
}

TEST_CASE("along a graph so long that the linear solution vanishes, the chordal start goes on") {
  // A ladder whose rungs bear much noise: the free matrices shrink by some e^-0.5 a rung.
  Random random;
  INFO(random.replay());
  const Index n = 6000;
  test::Pairs pairs = test::path(n);
  for (Index i = 0; i + 3 < n; ++i) {
    pairs.emplace_back(i, i + 2);
    pairs.emplace_back(i, i + 3);
  }
  const auto edges = test::simulate(random, pairs, 0.8);
  const auto R = chordal(MeasurementGraph(edges));
  REQUIRE(R.has_value());
  // As good at the far end as near the root.
  std::vector<double> cost(10, 0.0);
  for (const RelativeRotation& e : edges) {
    const auto part = static_cast<std::size_t>(e.i * 10 / n);
    cost[part] +=
        ((*R)[static_cast<std::size_t>(e.i)] * e.i_from_j - (*R)[static_cast<std::size_t>(e.j)])
            .squaredNorm();
  }
  for (const double part : cost) CHECK(part < 1.5 * cost[0]);
}

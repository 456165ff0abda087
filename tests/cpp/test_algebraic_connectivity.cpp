#include <cmath>

#include <doctest/doctest.h>

#include <rotavg/graph/algebraic_connectivity.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;

double connectivity(const MeasurementGraph& graph, Index component = 0) {
  return algebraic_connectivity(graph, connected_components(graph), component);
}

}  // namespace

TEST_CASE("the algebraic connectivity of cycles, paths and complete graphs is the closed form") {
  Random random;
  INFO(random.replay());
  for (const Index n : {3, 4, 5, 20, 101, 1000}) {
    CAPTURE(n);
    const double of_cycle = 2.0 - 2.0 * std::cos(2.0 * pi / n);
    const double of_path = 2.0 - 2.0 * std::cos(pi / n);
    CHECK(connectivity(simulate_graph(random, test::cycle(n), 1.0)) ==
          doctest::Approx(of_cycle).epsilon(1e-7));
    CHECK(connectivity(simulate_graph(random, test::path(n), 1.0)) ==
          doctest::Approx(of_path).epsilon(1e-7));
  }
  for (const Index n : {2, 3, 4, 5, 20, 60}) {
    CAPTURE(n);
    CHECK(connectivity(simulate_graph(random, test::complete(n), 1.0)) ==
          doctest::Approx(n).epsilon(1e-9));
  }
}

TEST_CASE("the algebraic connectivity is the second eigenvalue of each component's Laplacian") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = test::scattered_graph(random);
    const Components components = connected_components(graph);
    for (Index c = 0; c < components.size(); ++c) {
      const auto size = static_cast<Eigen::Index>(components.nodes[c].size());
      const double lambda_2 = algebraic_connectivity(graph, components, c);
      if (size == 1) {
        REQUIRE(std::isnan(lambda_2));
        continue;
      }
      Eigen::MatrixXd L = Eigen::MatrixXd::Zero(size, size);
      for (const Edge& e : graph.edges()) {
        if (components.label[e.i] != c) continue;
        const Index a = components.row_in_component[e.i], b = components.row_in_component[e.j];
        L(a, a) += e.weight;
        L(b, b) += e.weight;
        L(a, b) -= e.weight;
        L(b, a) -= e.weight;
      }
      const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(size, size);
      REQUIRE((apply_laplacian(graph, components, c, identity) - L).norm() <= 1e-14 * L.norm());
      REQUIRE(lambda_2 == doctest::Approx(test::dense_eigenvalues(L)(1)).epsilon(1e-7));
    }
  }
}

TEST_CASE("the algebraic connectivity scales with the weights") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 20, 30), 1.0);
  const double of_ones = connectivity(MeasurementGraph(measurements));
  for (const double scale : {1e-90, 1e-6, 1e6, 1e90}) {
    for (RelativeRotation& m : measurements) m.weight = scale;
    CHECK(connectivity(MeasurementGraph(measurements)) / scale ==
          doctest::Approx(of_ones).epsilon(1e-8));
  }
}

TEST_CASE("an algebraic connectivity whose computation was stopped is NaN") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::grid(20, 20), 1.0);
  const Components components = connected_components(graph);
  const auto stop = [] { return false; };
  CHECK(std::isnan(algebraic_connectivity(graph, components, 0, stop)));
}

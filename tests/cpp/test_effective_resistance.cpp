#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <doctest/doctest.h>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/effective_resistance.hpp>
#include <rotavg/graph/measurement_graph.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Relative standard deviation of an estimate from 32 samples, sqrt(2 / 32).
constexpr double deviation = 0.25;

bool is_about(double estimate, double exact) {
  return estimate > 0.3 * exact && estimate < 2.5 * exact;
}

}  // namespace

TEST_CASE("along a path resistances add up, and beside one another conductances") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph path = simulate_graph(random, test::path(41), 1.0);
  const auto along = effective_resistances(path, {{0, 40}, {7, 3}, {5, 5}}, 1e9, 1);
  REQUIRE(along.has_value());
  CHECK(is_about((*along)[0], 40.0));
  CHECK(is_about((*along)[1], 4.0));
  CHECK((*along)[2] == 0.0);
  const MeasurementGraph cycle = simulate_graph(random, test::cycle(40), 1.0);
  const auto around = effective_resistances(cycle, {{0, 20}}, 1e9, 1);
  REQUIRE(around.has_value());
  CHECK(is_about((*around)[0], 10.0));
}

TEST_CASE("effective resistances are those of the dense Laplacian, without bias") {
  Random random;
  INFO(random.replay());
  double sum = 0.0, squares = 0.0;
  int count = 0;
  for (int round = 0; round < 30; ++round) {
    auto measurements = test::simulate(random, test::random_connected(random, 20, 40), 1.0);
    for (RelativeRotation& m : measurements) m.weight = std::pow(10.0, random.uniform(-2.0, 2.0));
    const MeasurementGraph graph(measurements);
    const Index n = graph.num_nodes();
    Eigen::MatrixXd L = Eigen::MatrixXd::Constant(n, n, 1.0);  // + 1 1^T: regular, and the same
    for (const Edge& e : graph.edges()) {
      L(e.i, e.i) += e.weight;
      L(e.j, e.j) += e.weight;
      L(e.i, e.j) -= e.weight;
      L(e.j, e.i) -= e.weight;
    }
    const Eigen::MatrixXd inverse = L.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    std::vector<std::pair<Index, Index>> pairs;
    for (int k = 0; k < 5; ++k) pairs.emplace_back(random.below(n), random.below(n));
    const auto found = effective_resistances(graph, pairs, 1e9, 1);
    REQUIRE(found.has_value());
    for (std::size_t p = 0; p < pairs.size(); ++p) {
      const auto [i, j] = pairs[p];
      if (i == j) continue;
      const double exact = inverse(i, i) + inverse(j, j) - 2.0 * inverse(i, j);
      const double off = (*found)[p] / exact - 1.0;
      CHECK(is_about((*found)[p], exact));
      sum += off;
      squares += off * off;
      ++count;
    }
  }
  CHECK(std::abs(sum / count) < 6.0 * deviation / std::sqrt(count));
  CHECK(std::sqrt(squares / count) < 1.5 * deviation);
}

TEST_CASE("effective resistances of several components, and none where the factor is too large") {
  Random random;
  INFO(random.replay());
  std::vector<RelativeRotation> measurements;
  for (NodeId i = 0; i < 9; ++i) {
    if (i != 4) measurements.push_back({i, i + 1, random.rotation(), 4.0});
  }
  const MeasurementGraph graph(measurements);
  const auto found = effective_resistances(graph, {{0, 4}, {5, 9}}, 1e9, 1);
  REQUIRE(found.has_value());
  for (const double r : *found) CHECK(is_about(r, 1.0));
  CHECK_FALSE(effective_resistances(graph, {{0, 4}}, 1.0, 1).has_value());
  const auto stop = [] { return false; };
  const MeasurementGraph grid = simulate_graph(random, test::grid(60, 60), 1.0);
  CHECK_FALSE(effective_resistances(grid, {{0, 4}}, 1e12, 1, stop).has_value());
}

TEST_CASE(
    "the resistance between an edge's ends, exactly: of trees 1 / weight, else the Laplacian's") {
  Random random;
  INFO(random.replay());
  for (int round = 0; round < 20; ++round) {
    auto measurements = test::simulate(random, test::random_connected(random, 15, 25), 1.0);
    for (RelativeRotation& m : measurements) m.weight = std::pow(10.0, random.uniform(-2.0, 2.0));
    for (const RelativeRotation& m : test::simulate(random, test::path(5), 1.0)) {
      measurements.push_back({m.i + 100, m.j + 100, m.i_from_j, 4.0});  // another component
    }
    const MeasurementGraph graph(measurements);
    const auto found = edge_resistances(graph, 1e9, 1);
    REQUIRE(found.has_value());
    const Index n = graph.num_nodes();
    Eigen::MatrixXd L = Eigen::MatrixXd::Zero(n, n);
    for (const Edge& e : graph.edges()) {
      L(e.i, e.i) += e.weight;
      L(e.j, e.j) += e.weight;
      L(e.i, e.j) -= e.weight;
      L(e.j, e.i) -= e.weight;
    }
    for (Index i = 0; i < n; ++i) {  // + 1 1^T of each component: regular, and the same
      for (Index j = 0; j < n; ++j) {
        if ((graph.nodes()[i] < 100) == (graph.nodes()[j] < 100)) L(i, j) += 1.0;
      }
    }
    const Eigen::MatrixXd inverse = L.llt().solve(Eigen::MatrixXd::Identity(n, n));
    for (Index k = 0; k < graph.num_edges(); ++k) {
      const Edge& e = graph.edges()[k];
      const double exact = inverse(e.i, e.i) + inverse(e.j, e.j) - 2.0 * inverse(e.i, e.j);
      CHECK((*found)[k] == doctest::Approx(exact).epsilon(1e-8));
      if (e.weight == 4.0) CHECK((*found)[k] == doctest::Approx(0.25).epsilon(1e-12));
    }
  }
}

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <numeric>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/init/edge_support.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// R_ab from an edge between nodes a and b.
Matrix3 a_from_b(const Edge& e, Index a) {
  return e.i == a ? e.i_from_j() : Matrix3(e.i_from_j().transpose());
}

/// Between unit quaternions, from the angle t between the rotations: 2 sin(t / 4), squared.
double distance2(const Matrix3& A, const Matrix3& B) {
  return std::pow(2.0 * std::sin(angle_between(A, B) / 4.0), 2);
}

/// edge_support() from its definition, on a graph that needs no sampling.
std::vector<double> support_by_definition(const MeasurementGraph& graph) {
  struct Detour {
    Index edge;
    double distance2, weight;
  };
  std::vector<Detour> detours;
  const auto& edges = graph.edges();
  for (Index e = 0; e < graph.num_edges(); ++e) {
    const Edge edge = edges[e];
    const Index i = edge.i, j = edge.j;
    const Matrix3 i_from_j = edge.i_from_j();
    for (const Edge& f : edges) {
      for (const Edge& g : edges) {
        for (Index k = 0; k < graph.num_nodes(); ++k) {
          const bool first = (f.i == i && f.j == k) || (f.i == k && f.j == i);
          const bool second = (g.i == k && g.j == j) || (g.i == j && g.j == k);
          if (k == i || k == j || !first || !second) continue;
          const Matrix3 detour = a_from_b(f, i) * a_from_b(g, k);
          detours.push_back(
              {e, distance2(detour, i_from_j), f.weight * g.weight / (f.weight + g.weight)});
        }
      }
    }
  }
  std::vector<double> sorted;
  for (const Detour& d : detours) sorted.push_back(d.distance2);
  std::sort(sorted.begin(), sorted.end());
  const double scale2 = sorted.empty() ? 1.0 : sorted[sorted.size() / 10];
  std::vector<double> support;
  for (const Edge& e : edges) support.push_back(e.weight);
  for (const Detour& d : detours) {
    support[d.edge] += d.weight * std::pow(1.0 + d.distance2 / scale2, -2);
  }
  return support;
}

/// The total support of a maximum spanning forest, by Kruskal's algorithm.
double largest_total(const MeasurementGraph& graph, const std::vector<double>& support) {
  std::vector<Index> order(support.size()), part(graph.num_nodes());
  std::iota(order.begin(), order.end(), 0);
  std::iota(part.begin(), part.end(), 0);
  std::sort(order.begin(), order.end(), [&](Index a, Index b) { return support[a] > support[b]; });
  const std::function<Index(Index)> find = [&](Index i) {
    return part[i] == i ? i : find(part[i]);
  };
  double total = 0.0;
  for (const Index e : order) {
    const Index a = find(graph.edges()[e].i), b = find(graph.edges()[e].j);
    if (a == b) continue;
    part[a] = b;
    total += support[e];
  }
  return total;
}

/// Small noise on most measurements, and some drawn at random.
std::vector<RelativeRotation> with_outliers(Random& random, const test::Pairs& pairs,
                                            const Rotations& truth, double fraction) {
  auto measurements = test::measure(random, pairs, truth, 0.03);
  for (RelativeRotation& m : measurements) {
    if (random.uniform(0.0, 1.0) < fraction) m.i_from_j = random.rotation();
  }
  return measurements;
}

double largest_error(const Rotations& R, const Rotations& truth) {
  double largest = 0.0;
  for (std::size_t i = 0; i < R.size(); ++i) {
    largest =
        std::max(largest, angle_between(R[0].transpose() * R[i], truth[0].transpose() * truth[i]));
  }
  return largest;
}

}  // namespace

TEST_CASE("without noise the spanning-tree value is optimal: below 1e-20 per edge") {
  Random random;
  INFO(random.replay());
  const std::vector<test::Pairs> graphs = {
      test::complete(2),
      test::complete(50),
      test::cycle(2000),
      test::grid(20, 20),
      test::random_connected(random, 300, 0),
      test::random_connected(random, 300, 2000),
  };
  for (const test::Pairs& pairs : graphs) {
    auto measurements = test::simulate(random, pairs, 0.0);
    CAPTURE(measurements.size());
    const MeasurementGraph graph(measurements);
    CHECK(objective(graph, spanning_tree_init(graph)) < 1e-20 * graph.num_edges());
    test::spread_weights(random, 6.0, measurements);
    const MeasurementGraph weighted(measurements);
    CHECK(objective(weighted, spanning_tree_init(weighted)) < 1e-20 * weighted.total_weight());
  }
}

TEST_CASE("the first node of every component is the root, a lone node too") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::complete(6), 0.5);
  for (RelativeRotation m : test::simulate(random, test::cycle(5), 0.5)) {
    m.i += 10;
    m.j += 10;
    measurements.push_back(m);
  }
  const MeasurementGraph graph(measurements, {14, 13, 99, 12, 11, 10, 5, 4, 3, 2, 1, 0});
  const Rotations R = spanning_tree_init(graph);
  for (const Index root : {0, 2, 6}) CHECK(R[root] == Matrix3::Identity());
  for (const Index other : {1, 3, 4, 5, 7, 8, 9, 10, 11}) CHECK(R[other] != Matrix3::Identity());
}

TEST_CASE("the support of an edge is that of its definition") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    test::Pairs pairs = test::complete(9);
    for (int dropped = 0; dropped < 12; ++dropped) {
      pairs.erase(pairs.begin() + random.below(static_cast<Index>(pairs.size())));
    }
    auto measurements = test::simulate(random, pairs, 0.3);
    test::spread_weights(random, 1.0, measurements);
    const MeasurementGraph graph(measurements);
    const std::vector<double> support = edge_support(graph);
    const std::vector<double> expected = support_by_definition(graph);
    REQUIRE(support.size() == expected.size());
    for (std::size_t e = 0; e < support.size(); ++e) {
      REQUIRE(support[e] == doctest::Approx(expected[e]).epsilon(1e-9));
    }
  }
}

TEST_CASE("parallel edges support each other where they agree") {
  const Matrix3 turn = exp_so3({0.0, 0.0, 1.0}), other = exp_so3({0.0, 2.0, 0.0});
  const MeasurementGraph graph({{0, 1, turn, 2.0},
                                {1, 0, turn.transpose(), 3.0},  // the same measurement
                                {0, 1, other, 5.0},
                                {1, 2, other, 7.0}});
  const std::vector<double> support = edge_support(graph);
  CHECK(support[0] == doctest::Approx(2.0 + 3.0));
  CHECK(support[1] == doctest::Approx(3.0 + 2.0));
  CHECK(support[2] == doctest::Approx(5.0));
  CHECK(support[3] == doctest::Approx(7.0));
}

TEST_CASE("the tree has the largest support that a spanning tree can have") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 30; ++k) {
    const MeasurementGraph graph =
        test::simulate_graph(random, test::random_connected(random, 25, 60), 0.8);
    const Rotations R = spanning_tree_init(graph);
    const std::vector<double> support = edge_support(graph);
    double total = 0.0;
    Index edges_of_tree = 0;
    for (Index e = 0; e < graph.num_edges(); ++e) {
      if (residual(graph.edges()[e], R).norm() > 1e-13) continue;
      total += support[e];
      ++edges_of_tree;
    }
    REQUIRE(edges_of_tree == 24);
    REQUIRE(total == doctest::Approx(largest_total(graph, support)).epsilon(1e-12));
  }
}

TEST_CASE("where nothing tells the edges apart, the tree is one of shortest paths") {
  Random random;
  INFO(random.replay());
  for (const test::Pairs& pairs : {test::grid(12, 9), test::cycle(31)}) {
    const MeasurementGraph graph = test::simulate_graph(random, pairs, 1.0);
    const std::vector<Index> depth = breadth_first_forest(graph).depth;
    const Rotations R = spanning_tree_init(graph);
    Index measured_exactly = 0;
    for (const Edge& e : graph.edges()) {
      if (residual(e, R).norm() > 1e-13) continue;
      CHECK(std::abs(depth[e.i] - depth[e.j]) == 1);
      ++measured_exactly;
    }
    CHECK(measured_exactly == graph.num_nodes() - 1);
  }
}

TEST_CASE("outliers stay out of the tree, on graphs where triangles are sampled, too") {
  Random random;
  INFO(random.replay());
  for (const Index n : {60, 450}) {  // of 449 neighbours some 40 are tried
    for (const double fraction : {0.2, 0.4}) {
      const Rotations truth = random.rotations(n);
      const MeasurementGraph graph(with_outliers(random, test::complete(n), truth, fraction));
      CAPTURE(n);
      CAPTURE(fraction);
      CHECK(largest_error(spanning_tree_init(graph), truth) < 0.5);
      CHECK(largest_error(shortest_path_init(graph), truth) > 1.5);
    }
  }
}

TEST_CASE("heavy edges are preferred where there are no triangles") {
  // A cycle with one light edge: the tree leaves that one out.
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::cycle(20), 0.5);
  for (RelativeRotation& m : measurements) m.weight = random.uniform(1.0, 2.0);
  measurements[3].weight = 0.5;
  const MeasurementGraph graph(measurements);
  const Rotations R = spanning_tree_init(graph);
  for (Index e = 0; e < 20; ++e) {
    CHECK((residual(graph.edges()[e], R).norm() < 1e-13) == (e != 3));
  }
}

TEST_CASE("the tree does not depend on the unit of the weights") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 40, 200), 0.5);
  test::spread_weights(random, 1.0, measurements);
  const Rotations R = spanning_tree_init(MeasurementGraph(measurements));
  for (const int exponent : {-300, 300}) {
    auto scaled = measurements;
    for (RelativeRotation& m : scaled) m.weight = std::ldexp(m.weight, exponent);
    const Rotations S = spanning_tree_init(MeasurementGraph(scaled));
    CHECK(std::memcmp(R.data(), S.data(), R.size() * sizeof(Matrix3)) == 0);
  }
}

TEST_CASE("solve starts from the spanning tree that is asked for") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(12), 0.3);
  SolveOptions options;
  options.init = Initialization::spanning_tree;
  options.iteration.max_iterations = 0;
  const Solution start = solve(graph, options);
  CHECK(start.init == Initialization::spanning_tree);
  const double f = objective(graph, spanning_tree_init(graph));
  CHECK(start.objective == doctest::Approx(f).epsilon(1e-12));
  options.iteration.max_iterations = 1000;
  CHECK(solve(graph, options).certificate.verdict == Verdict::proved);
}

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/algebraic_connectivity.hpp>
#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Rt assembled from the rows of the graph, and from nothing else of it.
Eigen::MatrixXd measurements_from_rows(const MeasurementGraph& graph) {
  Eigen::MatrixXd Rt = Eigen::MatrixXd::Zero(3 * graph.num_nodes(), 3 * graph.num_nodes());
  for (Index l = 0; l < graph.num_nodes(); ++l) {
    for (const HalfEdge& h : graph.row(l)) Rt.block<3, 3>(3 * l, 3 * h.node) += graph.block(h);
  }
  return Rt;
}

/// Edges between all pairs of nodes by Floyd's algorithm; n where there is no path.
Eigen::MatrixXi distances(const MeasurementGraph& graph) {
  const Index n = graph.num_nodes();
  Eigen::MatrixXi distance = Eigen::MatrixXi::Constant(n, n, n);
  distance.diagonal().setZero();
  for (const Edge& e : graph.edges()) distance(e.i, e.j) = distance(e.j, e.i) = 1;
  for (Index k = 0; k < n; ++k) {
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        distance(i, j) = std::min(distance(i, j), distance(i, k) + distance(k, j));
      }
    }
  }
  return distance;
}

/// Up to 12 nodes and few edges: several components, isolated nodes and parallel edges.
MeasurementGraph scattered_graph(Random& random) {
  const Index n = 2 + random.below(11);
  test::Pairs pairs;
  for (Index k = 1 + random.below(n); k > 0; --k) {
    const Index i = random.below(n);
    pairs.emplace_back(i, (i + 1 + random.below(n - 1)) % n);
  }
  auto measurements = test::measure(random, pairs, random.rotations(n), 1.0);
  test::spread_weights(random, 1.0, measurements);
  std::vector<NodeId> nodes;
  for (NodeId id = 0; id < n; ++id) nodes.push_back(id);
  return MeasurementGraph(measurements, nodes);
}

double connectivity(const MeasurementGraph& graph, Index component = 0) {
  return algebraic_connectivity(graph, connected_components(graph), component);
}

}  // namespace

TEST_CASE("the rows hold the symmetric block matrix Rt, parallel edges added up") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = scattered_graph(random);
    const Eigen::MatrixXd Rt = test::dense_measurements(graph);
    REQUIRE((measurements_from_rows(graph) - Rt).norm() <= 1e-15 * Rt.norm());
    REQUIRE((Rt - Rt.transpose()).norm() == 0.0);
    double degrees = 0.0;
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      double degree = 0.0;
      for (const HalfEdge& h : graph.row(l)) degree += graph.edges()[h.edge()].weight;
      REQUIRE(graph.degree(l) == degree);
      degrees += degree;
    }
    REQUIRE(degrees == doctest::Approx(2.0 * graph.total_weight()).epsilon(1e-14));
  }
}

TEST_CASE("two measurements and their graph, block by block") {
  Random random;
  INFO(random.replay());
  const Matrix3 A = random.rotation(), B = random.rotation();
  const MeasurementGraph graph({{10, 20, A, 2.0}, {30, 10, B, 0.5}, {20, 10, B, 3.0}});
  CHECK(graph.num_nodes() == 3);
  CHECK(graph.num_edges() == 3);
  CHECK(graph.nodes() == std::vector<NodeId>{10, 20, 30});
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(9, 9);
  expected.block<3, 3>(0, 3) = 2.0 * A + 3.0 * B.transpose();
  expected.block<3, 3>(3, 0) = 2.0 * A.transpose() + 3.0 * B;
  expected.block<3, 3>(6, 0) = 0.5 * B;
  expected.block<3, 3>(0, 6) = 0.5 * B.transpose();
  CHECK((measurements_from_rows(graph) - expected).norm() < 1e-14);
  CHECK(graph.degree(0) == 5.5);
  CHECK(graph.degree(1) == 5.0);
  CHECK(graph.degree(2) == 0.5);
  CHECK(graph.total_weight() == 5.5);
  CHECK(graph.row(0).size() == 3);
  CHECK((*graph.row(0).begin()).edge() == 0);
}

TEST_CASE("nodes may have any 64-bit ids, and stand in rising order unless one is given") {
  constexpr NodeId lowest = std::numeric_limits<NodeId>::min();
  constexpr NodeId highest = std::numeric_limits<NodeId>::max();
  const std::vector<RelativeRotation> measurements = {{highest, -1}, {0, lowest}, {-1, 0}};
  const MeasurementGraph rising(measurements);
  CHECK(rising.nodes() == std::vector<NodeId>{lowest, -1, 0, highest});
  CHECK(rising.edges()[0].i == 3);
  CHECK(rising.edges()[0].j == 1);

  const std::vector<NodeId> order = {0, highest, 42, lowest, -1};
  const MeasurementGraph given(measurements, order);
  CHECK(given.nodes() == order);
  CHECK(given.edges()[0].i == 1);
  CHECK(given.edges()[0].j == 4);
  CHECK(given.row(2).size() == 0);
  CHECK(given.degree(2) == 0.0);
}

TEST_CASE("an edge that no graph can hold is refused with its number and the reason") {
  struct Case {
    std::string reason;
    std::function<void(RelativeRotation&)> spoil;
  };
  const std::vector<Case> cases = {
      {"joins a node to itself", [](auto& m) { m.j = m.i; }},
      {"found the weight 0", [](auto& m) { m.weight = 0.0; }},
      {"found the weight -1", [](auto& m) { m.weight = -1.0; }},
      {"found the weight nan", [](auto& m) { m.weight = not_a_number; }},
      {"found the weight inf", [](auto& m) { m.weight = infinity; }},
      {"found the weight 1e-101", [](auto& m) { m.weight = 1e-101; }},
      {"found the weight 1e+101", [](auto& m) { m.weight = 1e101; }},
      {"NaN or an infinity", [](auto& m) { m.i_from_j(0, 0) = not_a_number; }},
      {"NaN or an infinity", [](auto& m) { m.i_from_j(2, 1) = not_a_number; }},
      {"NaN or an infinity", [](auto& m) { m.i_from_j(1, 2) = -infinity; }},
      {"R^T R differs from the identity by 3", [](auto& m) { m.i_from_j *= 2.0; }},
      {"R^T R differs from the identity by 1", [](auto& m) { m.i_from_j.setZero(); }},
      {"not a rotation", [](auto& m) { m.i_from_j(0, 1) += 2e-3; }},
      {"not a rotation", [](auto& m) { m.i_from_j.setConstant(1e200); }},
      {"not a rotation", [](auto& m) { m.i_from_j(0, 1) = 1e300; }},
      {"its determinant is -1", [](auto& m) { m.i_from_j *= -1.0; }},
      {"its determinant is -1", [](auto& m) { m.i_from_j.col(0) *= -1.0; }},
      {"node 77 is not in the list", [](auto& m) { m.j = 77; }},
  };
  for (const Case& c : cases) {
    std::vector<RelativeRotation> measurements = {{1, 2}, {2, 3}, {3, 4}, {4, 5}, {5, 1}};
    c.spoil(measurements[3]);
    CAPTURE(c.reason);
    try {
      const MeasurementGraph graph(measurements, {1, 2, 3, 4, 5});
      FAIL_CHECK("the edge was taken");
    } catch (const InvalidEdge& error) {
      CAPTURE(error.what());
      CHECK(error.edge() == 3);
      CHECK(error.reason().find(c.reason) != std::string::npos);
      CHECK(std::string(error.what()) == "edge 3: " + error.reason());
    }
  }
}

TEST_CASE("no edges, and a node that stands twice, are refused") {
  const std::vector<RelativeRotation> one_edge = {{1, 2}};
  CHECK_THROWS_WITH_AS(MeasurementGraph(std::vector<RelativeRotation>{}), "the graph has no edges",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(MeasurementGraph({}, {1, 2}), "the graph has no edges",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(MeasurementGraph(one_edge, {2, 1, 7, 1}),
                       "node 1 stands twice in the list of nodes", std::invalid_argument);
}

TEST_CASE("a measurement rounded to four digits is snapped to a rotation, an exact one is kept") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Matrix3 exact = random.rotation();
    const Matrix3 rounded = exact.unaryExpr([](double x) { return std::round(x * 1e4) / 1e4; });
    const MeasurementGraph graph({{0, 1, exact}, {0, 1, rounded}});
    REQUIRE((graph.edges()[0].i_from_j() - exact).norm() < 2e-15);
    const Matrix3 snapped = graph.edges()[1].i_from_j();
    const double error = (snapped.transpose() * snapped - Matrix3::Identity()).norm();
    REQUIRE(error < 1e-14);
    REQUIRE((snapped - exact).norm() < 2e-4);
  }
}

TEST_CASE("a quaternion of any length is taken, and one of the right length keeps its bits") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Matrix3 R = random.rotation();
    const double weight = std::exp(random.uniform(-9.0, 9.0));
    WeightedQuaternion q(R);
    q.coeffs() *= std::exp(random.uniform(-300.0, 300.0));
    const auto graph_of = [&](const WeightedQuaternion& given) {
      return MeasurementGraph(
          1, [&](std::size_t) { return RelativeQuaternion{0, 1, given, weight}; }, {0, 1});
    };
    const MeasurementGraph graph = graph_of(q);
    const Edge edge = graph.edges()[0];
    REQUIRE((edge.i_from_j() - R).norm() < 3e-15);
    REQUIRE(edge.weight == weight);
    REQUIRE(std::abs(edge.quaternion.squaredNorm() / weight - 1.0) < 2e-15);
    const MeasurementGraph again = graph_of(edge.quaternion);
    REQUIRE(again.edges()[0].quaternion.coeffs() == edge.quaternion.coeffs());
  }
}

TEST_CASE("bad quaternions are refused") {
  const auto refused = [](const WeightedQuaternion& q, const char* reason) {
    const auto make = [&] {
      MeasurementGraph(2,
                       [&](std::size_t k) {
                         return RelativeQuaternion{0, 1, k ? q : WeightedQuaternion::Identity()};
                       },
                       {0, 1});
    };
    CHECK_THROWS_WITH_AS(make(), doctest::Contains(reason), InvalidEdge);
  };
  refused({0.0, 0.0, 0.0, 0.0}, "edge 1: the quaternion is zero");
  refused({1.0, not_a_number, 0.0, 0.0}, "NaN or an infinity");
  refused({infinity, 0.0, 0.0, 0.0}, "NaN or an infinity");
}

TEST_CASE("rows of half-edges one behind the other are those of the graph, in any order") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = scattered_graph(random);
    std::vector<Index> order(static_cast<std::size_t>(graph.num_nodes()));
    std::iota(order.rbegin(), order.rend(), 0);
    const HalfEdgeRows plain(graph), reversed(graph, &order);
    for (const HalfEdgeRows* rows : {&plain, &reversed}) {
      REQUIRE(rows->num_nodes() == graph.num_nodes());
      REQUIRE(rows->num_edges() == graph.num_edges());
      for (Index l = 0; l < graph.num_nodes(); ++l) {
        REQUIRE(rows->row(l).size() == graph.row(l).size());
        auto expected = graph.row(l).begin();
        for (const HalfEdge& h : rows->row(l)) {
          const HalfEdge e = *expected;
          ++expected;
          REQUIRE(h.node == e.node);
          REQUIRE(h.edge_and_end == e.edge_and_end);
          REQUIRE(h.node_from_l.coeffs() == e.node_from_l.coeffs());
        }
      }
    }
    if (graph.num_nodes() < 2 || graph.row(0).size() == 0) continue;
    CHECK(plain.row(0).begin() < plain.row(graph.num_nodes() - 1).end());
    CHECK(reversed.row(0).begin() >= reversed.row(graph.num_nodes() - 1).end());
  }
}

TEST_CASE("an edge takes 64 bytes") {
  std::vector<RelativeRotation> measurements;
  for (NodeId k = 0; k < 10'000; ++k) measurements.push_back({k % 100, 100 + k % 77});
  const MeasurementGraph graph(measurements);
  const double of_nodes = 24.0 * graph.num_nodes() + 8.0;
  CHECK((static_cast<double>(graph.bytes()) - of_nodes) / graph.num_edges() <= 64.0);
}

TEST_CASE("ids that count up need no list, from wherever they do") {
  constexpr NodeId lowest = std::numeric_limits<NodeId>::min();
  constexpr NodeId highest = std::numeric_limits<NodeId>::max();
  for (const NodeId first : {lowest, NodeId{-1}, NodeId{0}, NodeId{7}, highest - 2}) {
    const NodeRows rows({first, first + 1, first + 2});
    for (Index k = 0; k < 3; ++k) CHECK(rows.find(first + k) == k);
    for (const NodeId other : {lowest, NodeId{-2}, NodeId{3}, NodeId{12}, highest}) {
      if (other < first || other > first + 2) CHECK(rows.find(other) == -1);
    }
  }
  CHECK(NodeRows({}).find(0) == -1);
  CHECK(NodeRows({5, 4}).find(4) == 1);
}

TEST_CASE("components are the classes of nodes with a path between them") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const MeasurementGraph graph = scattered_graph(random);
    const Index n = graph.num_nodes();
    const Eigen::MatrixXi distance = distances(graph);
    const Components components = connected_components(graph);
    Index nodes_seen = 0;
    for (Index c = 0; c < components.size(); ++c) {
      const auto& nodes = components.nodes[c];
      nodes_seen += static_cast<Index>(nodes.size());
      REQUIRE(std::is_sorted(nodes.begin(), nodes.end()));
      REQUIRE(components.root(c) == nodes.front());
      if (c > 0) REQUIRE(components.root(c - 1) < components.root(c));
      for (std::size_t row = 0; row < nodes.size(); ++row) {
        REQUIRE(components.label[nodes[row]] == c);
        REQUIRE(components.row_in_component[nodes[row]] == static_cast<Index>(row));
      }
    }
    REQUIRE(nodes_seen == n);
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        REQUIRE((components.label[i] == components.label[j]) == (distance(i, j) < n));
      }
    }
  }
}

TEST_CASE("the breadth-first forest has the shortest paths to the first node of each component") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const MeasurementGraph graph = scattered_graph(random);
    const Eigen::MatrixXi distance = distances(graph);
    const Components components = connected_components(graph);
    const BreadthFirstForest forest = breadth_first_forest(graph);
    std::vector<bool> seen(static_cast<std::size_t>(graph.num_nodes()), false);
    for (const Index i : forest.order) {
      const Index root = components.root(components.label[i]);
      const Index parent = forest.parent[i];
      REQUIRE(forest.depth[i] == distance(root, i));
      REQUIRE((parent < 0) == (i == root));
      if (parent >= 0) {
        REQUIRE(seen[parent]);
        REQUIRE(forest.depth[i] == forest.depth[parent] + 1);
        const Edge& e = graph.edges()[forest.tree_edge[i]];
        REQUIRE(((e.i == i && e.j == parent) || (e.i == parent && e.j == i)));
      } else {
        REQUIRE(forest.tree_edge[i] == -1);
      }
      REQUIRE(!seen[i]);
      seen[i] = true;
    }
    REQUIRE(forest.order.size() == static_cast<std::size_t>(graph.num_nodes()));
  }
}

TEST_CASE("an edge closes a cycle of one edge more than the tree path between its ends") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = scattered_graph(random);
    const BreadthFirstForest forest = breadth_first_forest(graph);
    std::vector<RelativeRotation> tree_edges;
    for (NodeId i = 0; i < graph.num_nodes(); ++i) {
      if (forest.parent[i] >= 0) tree_edges.push_back({i, forest.parent[i]});
    }
    const Eigen::MatrixXi tree_distance = distances(MeasurementGraph(tree_edges, graph.nodes()));
    std::vector<bool> in_tree(static_cast<std::size_t>(graph.num_edges()), false);
    for (const Index edge : forest.tree_edge) {
      if (edge >= 0) in_tree[edge] = true;
    }
    for (Index edge = 0; edge < graph.num_edges(); ++edge) {
      const Edge& e = graph.edges()[edge];
      const Index expected = in_tree[edge] ? 1 : tree_distance(e.i, e.j) + 1;
      REQUIRE(fundamental_cycle_length(graph, forest, edge) == expected);
    }
  }
}

TEST_CASE("an edge parallel to one of the forest closes a cycle of two edges") {
  const MeasurementGraph graph({{0, 1}, {1, 2}, {1, 0}});
  const BreadthFirstForest forest = breadth_first_forest(graph);
  CHECK(fundamental_cycle_length(graph, forest, 0) == 1);
  CHECK(fundamental_cycle_length(graph, forest, 1) == 1);
  CHECK(fundamental_cycle_length(graph, forest, 2) == 2);
}

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
    const MeasurementGraph graph = scattered_graph(random);
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

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/measurement_graph.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

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

}  // namespace

TEST_CASE("the rows hold the symmetric block matrix Rt, parallel edges added up") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = test::scattered_graph(random);
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
    const MeasurementGraph graph = test::scattered_graph(random);
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

TEST_CASE("rows that several threads have made are those of one") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph(
      test::simulate(random, test::random_connected(random, 3000, 30000), 0.1));
  std::vector<Index> some;  // the last one is not among them
  for (Index i = 0; i < graph.num_nodes() - 1; i += 1 + random.below(3)) some.push_back(i);
  const auto same = [](const HalfEdgeRows& a, const HalfEdgeRows& b) {
    REQUIRE(a.num_nodes() == b.num_nodes());
    CHECK(a.num_edges() == b.num_edges());
    for (Index l = 0; l < a.num_nodes(); ++l) {
      REQUIRE(std::equal(a.row(l).begin(), a.row(l).end(), b.row(l).begin(), b.row(l).end(),
                         [](const HalfEdge& x, const HalfEdge& y) {
                           return x.node == y.node && x.edge_and_end == y.edge_and_end &&
                                  x.node_from_l.coeffs() == y.node_from_l.coeffs();
                         }));
    }
  };
  for (const int num_threads : {2, 3, 8}) {
    CAPTURE(num_threads);
    same(HalfEdgeRows(graph), HalfEdgeRows(graph, nullptr, num_threads));
    same(HalfEdgeRows(graph, HalfEdgeRows::Only{some}),
         HalfEdgeRows(graph, HalfEdgeRows::Only{some}, num_threads));
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

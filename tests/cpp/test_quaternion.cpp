#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Geometry>
#include <Eigen/QR>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/init/quaternion.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

std::optional<Rotations> quaternion(const MeasurementGraph& graph, double max_flops = 5e10,
                                    const std::function<bool()>& keep_going = {}) {
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  return quaternion_init(graph, eliminations, max_flops, keep_going);
}

}  // namespace

namespace {

using WXYZ = std::array<double, 4>;  // w, x, y, z

WXYZ from_matrix(const Matrix3& R) {
  const Eigen::Quaterniond q(R);
  return {q.w(), q.x(), q.y(), q.z()};
}

double dot(const WXYZ& a, const WXYZ& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

/// Hamilton's table: rows of the linear map x -> x q.
std::array<WXYZ, 4> right_factor(const WXYZ& q) {
  const auto [w, x, y, z] = q;
  return {{{w, -x, -y, -z}, {x, w, z, -y}, {y, -z, w, x}, {z, y, -x, w}}};
}

WXYZ product(const WXYZ& a, const WXYZ& b) {
  const auto rows = right_factor(b);
  return {dot(rows[0], a), dot(rows[1], a), dot(rows[2], a), dot(rows[3], a)};
}

}  // namespace

TEST_CASE("the quaternion start is exact without noise, in every component") {
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
    std::vector<NodeId> nodes = {50};  // stands alone
    for (NodeId i = 0; i < 12; ++i) nodes.push_back(i);
    for (NodeId i = 100; i < 105; ++i) nodes.push_back(i);
    const MeasurementGraph graph(edges, nodes);
    const auto R = quaternion(graph);
    REQUIRE(R.has_value());
    CHECK(objective(graph, *R) <= 1e-20 * graph.total_weight());
    for (const Index root : {0, 1, 13}) CHECK((*R)[root] == Matrix3::Identity());
  }
}

TEST_CASE(
    "the quaternion start solves the least squares that it says, with the signs of the truth") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const test::Pairs pairs = test::random_connected(random, 8, 12);
    const Rotations truth = random.rotations(8);
    auto measurements = test::measure(random, pairs, truth, 0.3);
    test::spread_weights(random, 1.0, measurements);
    const MeasurementGraph graph(measurements);

    // All equations sqrt(w) (x_i q_ij - x_j) = 0, with x_0 = 1 moved to the right.
    const Index m = graph.num_edges();
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(4 * m, 4 * 8);
    for (Index e = 0; e < m; ++e) {
      const Edge& edge = graph.edges()[e];
      const WXYZ q = from_matrix(edge.i_from_j());
      const bool same = dot(product(from_matrix(truth[edge.i]), q), from_matrix(truth[edge.j])) > 0;
      const auto rows = right_factor(q);
      const double root = std::sqrt(edge.weight);
      for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c)
          A(4 * e + r, 4 * edge.i + c) = (same ? root : -root) * rows[r][c];
        A(4 * e + r, 4 * edge.j + r) -= root;
      }
    }
    // The truth has a sign of its own for each node, and any rotation at node 0.
    const Eigen::VectorXd x = A.rightCols(28).colPivHouseholderQr().solve(-A.col(0));
    const auto R = quaternion(graph);
    REQUIRE(R.has_value());
    for (Index i = 1; i < 8; ++i) {
      const auto x_i = x.segment<4>(4 * (i - 1));
      const Eigen::Quaterniond expected(x_i(0), x_i(1), x_i(2), x_i(3));
      CHECK(((*R)[i] - expected.normalized().matrix()).norm() < 1e-12);
    }
  }
}

TEST_CASE("where the noise is small the quaternion start is nearly optimal") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10; ++k) {
    const MeasurementGraph graph = test::simulate_graph(random, test::grid(10, 10), 0.1);
    const auto R = quaternion(graph);
    REQUIRE(R.has_value());
    const double optimum = newton(graph, *R).objective;
    CHECK(objective(graph, *R) <= 1.02 * optimum);
    CHECK(objective(graph, shortest_path_init(graph)) > 2.0 * optimum);
  }
}

TEST_CASE("the quaternion start is made of rotations, whatever the noise") {
  Random random;
  INFO(random.replay());
  // Far from the root of a noisy cycle the free quaternions fade away.
  for (const test::Pairs& pairs : {test::cycle(2000), test::grid(20, 20), test::complete(15)}) {
    const MeasurementGraph graph = test::simulate_graph(random, pairs, 3.0);
    const auto R = quaternion(graph);
    REQUIRE(R.has_value());
    for (const Matrix3& R_i : *R) {
      REQUIRE((R_i.transpose() * R_i - Matrix3::Identity()).norm() < 1e-14);
      REQUIRE(R_i.determinant() > 0.0);
    }
  }
}

TEST_CASE("where the quaternion start costs too much or is stopped, there is none") {
  Random random;
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(6), 0.5);
  CHECK(!quaternion(graph, 0.0).has_value());
  CHECK(!quaternion(graph, 1e9, [] { return false; }).has_value());
  SolveOptions options;
  options.init = Initialization::quaternion;
  CHECK(solve(graph, options).init == Initialization::quaternion);
  options.certificate.max_factorization_flops = 0.0;
  CHECK(solve(graph, options).init == Initialization::shortest_path);
}

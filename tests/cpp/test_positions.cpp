#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Dense>

#include <rotavg/poses/positions.hpp>
#include <rotavg/problem/check_rotations.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

struct Problem {
  MeasurementGraph graph;
  Rotations R;
  std::vector<Vector3> translations;
  std::vector<Matrix3> information;
};

/// Edges and poses at random, with translations that no positions meet.
Problem random_problem(Random& random, const test::Pairs& pairs, bool full) {
  Problem problem{MeasurementGraph(test::simulate(random, pairs, 0.2)), {}, {}, {}};
  problem.R = random.rotations(problem.graph.num_nodes());
  for (Index k = 0; k < problem.graph.num_edges(); ++k) {
    problem.translations.push_back(random.normal_vector());
    const Matrix3 root = random.normal_matrix();
    const double weight = random.power_of_ten(-2, 2);
    problem.information.push_back(full ? Matrix3(root * root.transpose() + Matrix3::Identity())
                                       : Matrix3(weight * Matrix3::Identity()));
  }
  return problem;
}

/// The same by a dense decomposition of J p = r, a block row for every edge and for what is held.
std::vector<Vector3> dense_positions(const Problem& problem,
                                     const std::vector<FixedPosition>& held) {
  const MeasurementGraph& graph = problem.graph;
  const Eigen::Index n = graph.num_nodes(), m = graph.num_edges();
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3 * m, 3 * n);
  Eigen::VectorXd r = Eigen::VectorXd::Zero(3 * m);
  for (Eigen::Index k = 0; k < m; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const Edge e = graph.edges()[at];
    const Matrix3 root = problem.information[at].llt().matrixU();
    const Matrix3 j_from_i = e.i_from_j().transpose();
    const Matrix3 A = root * j_from_i * problem.R[static_cast<std::size_t>(e.i)].transpose();
    J.block<3, 3>(3 * k, 3 * e.j) += A;
    J.block<3, 3>(3 * k, 3 * e.i) -= A;
    r.segment<3>(3 * k) = root * j_from_i * problem.translations[at];
  }
  Eigen::VectorXd p = Eigen::VectorXd::Zero(3 * n);
  std::vector<bool> is_held(static_cast<std::size_t>(n), false);
  for (const FixedPosition& h : held) {
    p.segment<3>(3 * h.node) = h.position;
    is_held[static_cast<std::size_t>(h.node)] = true;
  }
  std::vector<Eigen::Index> free;
  for (Eigen::Index c = 0; c < 3 * n; ++c) {
    if (!is_held[static_cast<std::size_t>(c / 3)]) free.push_back(c);
  }
  const Eigen::VectorXd solved = J(Eigen::all, free).colPivHouseholderQr().solve(r - J * p);
  for (std::size_t k = 0; k < free.size(); ++k) p(free[k]) = solved(static_cast<Eigen::Index>(k));
  std::vector<Vector3> result;
  for (Eigen::Index i = 0; i < n; ++i) result.emplace_back(p.segment<3>(3 * i));
  return result;
}

double largest_difference(const std::vector<Vector3>& a, const std::vector<Vector3>& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) largest = std::max(largest, (a[k] - b[k]).norm());
  return largest;
}

}  // namespace

TEST_CASE("positions are those of a dense decomposition") {
  Random random;
  INFO(random.replay());
  for (const bool full : {false, true}) {
    CAPTURE(full);
    for (const Index n : {2, 3, 12, 40}) {
      CAPTURE(n);
      const Problem problem = random_problem(random, test::random_connected(random, n, n), full);
      const std::vector<Vector3> found =
          positions(problem.graph, problem.R, problem.translations, problem.information);
      CHECK(largest_difference(found, dense_positions(problem, {{0, Vector3::Zero()}})) < 1e-9);
      // Held in several places, so that what is left falls into parts.
      std::vector<FixedPosition> held;
      for (NodeId node = n - 1; node >= 0; node -= 3)
        held.push_back({node, random.normal_vector()});
      const std::vector<Vector3> between =
          positions(problem.graph, problem.R, problem.translations, problem.information, held);
      CHECK(largest_difference(between, dense_positions(problem, held)) < 1e-9);
      for (const FixedPosition& h : held) {
        CHECK(between[static_cast<std::size_t>(h.node)] == h.position);
      }
    }
  }
}

TEST_CASE("without noise positions are met, in every component") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::random_connected(random, 10, 12);
  for (const auto& [i, j] : test::cycle(5)) pairs.emplace_back(i + 10, j + 10);
  Problem problem = random_problem(random, pairs, true);
  std::vector<Vector3> truth;
  for (Index i = 0; i < 15; ++i) truth.push_back(random.normal_vector());
  truth[0].setZero();  // the gauge of the first; the other's node 12 is held
  std::vector<RelativeRotation> exact;
  for (const auto& [i, j] : pairs) {
    const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
    exact.push_back({i, j, problem.R[a].transpose() * problem.R[b]});
    problem.translations[exact.size() - 1] = problem.R[a].transpose() * (truth[b] - truth[a]);
  }
  const MeasurementGraph graph(exact);
  const std::vector<FixedPosition> held{{12, truth[12]}};
  CHECK(largest_difference(positions(graph, problem.R, problem.translations, {}, held), truth) <
        1e-12);
  CHECK(largest_difference(
            positions(graph, problem.R, problem.translations, problem.information, held), truth) <
        1e-11);
}

TEST_CASE("a node without an edge is at the origin, or where it is held") {
  const MeasurementGraph graph({{0, 1, Matrix3::Identity()}}, {0, 1, 7, 8});
  const Rotations R(4, Matrix3::Identity());
  const std::vector<Vector3> p = positions(graph, R, {{1, 2, 3}}, {}, {{8, {4, 5, 6}}});
  CHECK(p[0] == Vector3::Zero());
  CHECK(p[1] == Vector3(1, 2, 3));
  CHECK(p[2] == Vector3::Zero());
  CHECK(p[3] == Vector3(4, 5, 6));
}

TEST_CASE("positions refuse what they cannot be fitted to, and say why") {
  const MeasurementGraph graph({{0, 1, Matrix3::Identity()}, {1, 2, Matrix3::Identity()}});
  const Rotations R(3, Matrix3::Identity());
  const std::vector<Vector3> t(2, Vector3::UnitX());
  const Matrix3 I = Matrix3::Identity();
  CHECK_THROWS_WITH_AS(positions(graph, R, {}),
                       "found 0 translations; expected 2, one for each edge",
                       std::invalid_argument);
  CHECK_THROWS_AS(positions(graph, R, t, {I}), std::invalid_argument);
  CHECK_THROWS_AS(positions(graph, Rotations(2, I), t), std::invalid_argument);
  CHECK_THROWS_AS(positions(graph, Rotations(3, Matrix3(2.0 * I)), t), InvalidRotation);
  const Vector3 nowhere = Vector3::Constant(std::numeric_limits<double>::quiet_NaN());
  CHECK_THROWS_WITH_AS(positions(graph, R, {t[0], nowhere}),
                       "edge 1: the translation holds a NaN or an infinity", InvalidEdge);
  Matrix3 flat = I;
  flat(2, 2) = 0.0;
  CHECK_THROWS_WITH_AS(positions(graph, R, t, {I, flat}),
                       "edge 1: the information about the translation is not positive definite",
                       InvalidEdge);
  CHECK_THROWS_WITH_AS(positions(graph, R, t, {}, {{5, {0, 0, 0}}}),
                       "the fixed position of node 5 is of no node of the graph",
                       std::invalid_argument);
  CHECK_THROWS_AS(positions(graph, R, t, {}, {{1, {0, 0, 0}}, {1, {0, 0, 0}}}),
                  std::invalid_argument);
  CHECK_THROWS_AS(positions(graph, R, t, {}, {{1, nowhere}}), std::invalid_argument);
  const Vector3 far = Vector3::Constant(1e308);
  CHECK_THROWS_AS(positions(graph, R, {far, far}), std::invalid_argument);
}

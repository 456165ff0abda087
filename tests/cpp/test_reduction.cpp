#include <cmath>
#include <limits>
#include <stdexcept>
#include <type_traits>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/LU>

#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/reduced_graph.hpp>
#include <rotavg/reduction/refined_gravity.hpp>
#include <rotavg/reduction/riding.hpp>
#include <rotavg/rotavg.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

TEST_CASE("a rotation takes one direction to another, opposite ones included") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 2000; ++k) {
    const Vector3 a = random.direction(), turn = random.power_of_ten(-12, 1) * random.direction();
    const Vector3 b = (k % 2 == 0 ? exp_so3(turn) * a : Vector3(-(exp_so3(turn) * a)));
    const Matrix3 Q = rotation_taking(a, b);
    CHECK((Q.transpose() * Q - Matrix3::Identity()).norm() < 1e-14);
    CHECK(Q.determinant() > 0.0);
    CHECK((Q * a - b).norm() < 3e-15);
  }
}

TEST_CASE("two edges to the world cost what gravity costs, and a constant") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 500; ++k) {
    const Vector3 g = random.direction(), d = random.direction();
    const Matrix3 R = random.rotation(), Q = rotation_taking(g, d), Q2 = Q * half_turn(g);
    const double w = random.power_of_ten(-3, 3);
    const double edges = w * (R * Q - Matrix3::Identity()).squaredNorm() +
                         w * (R * Q2 - Matrix3::Identity()).squaredNorm();
    CHECK(edges - 8.0 * w == doctest::Approx(gravity_cost(R, d, g, w)).epsilon(1e-12));
    // From the residual quaternion of the first edge alone.
    const MeasurementGraph graph({{1, 0, Q, w}, {1, 0, Q2, w}});
    const Vector4 e =
        residual_quaternion(graph.quaternion_edges()[0], to_quaternions({Matrix3::Identity(), R}));
    GravityPairs pairs;
    pairs.down = g;
    CHECK(pairs.cost(e) == doctest::Approx(gravity_cost(R, d, g, w)).epsilon(1e-12));
    CHECK(pairs.constant(e) == doctest::Approx(8.0 * w));
  }
}

TEST_CASE("the heading that is nearest to the identity") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Matrix3 R = random.rotation();
    const Vector3 g = random.direction();
    const double best = (heading_to_identity(R, g) * R).trace();
    for (double angle = -3.1; angle < 3.15; angle += 0.05) {
      CHECK((exp_so3(angle * g) * R).trace() <= best + 1e-12);
    }
  }
}

TEST_CASE("nodes that ride on variables: rotations there and back, and the same costs") {
  Random random;
  INFO(random.replay());
  const test::Pairs pairs = test::random_connected(random, 12, 30);
  const MeasurementGraph given = test::simulate_graph(random, pairs, 0.3);
  Riding riding = Riding::alone(12);
  riding.num_variables = 5;
  for (Index i = 0; i < 12; ++i) riding.variable[i] = i < 5 ? i : random.below(5);
  riding.variable_from_node = random.rotations(12);
  const ReducedGraph reduced(given, riding);
  const Rotations Q = random.rotations(5), R = riding.nodes_from(Q),
                  back = riding.variables_from(R);
  for (Index v = 0; v < 5; ++v) CHECK((back[v] - Q[v]).norm() < 1e-14);
  double constant = 0.0;
  std::vector<bool> kept(given.edges().size(), false);
  for (const Index k : reduced.kept()) kept[k] = true;
  for (Index k = 0; k < given.num_edges(); ++k) {
    if (!kept[k]) constant += given.edges()[k].weight * residual(given.edges()[k], R).squaredNorm();
  }
  CHECK(objective(reduced.graph(), Q) + constant == doctest::Approx(objective(given, R)));
  CHECK(constant > 0.0);

  Riding outer = Riding::alone(5);
  outer.num_variables = 2;
  outer.variable = {0, 0, 1, 1, 1};
  outer.variable_from_node = random.rotations(5);
  const Rotations P = random.rotations(2);
  const Rotations composed = riding_on(outer, riding).nodes_from(P);
  const Rotations stepwise = riding.nodes_from(outer.nodes_from(P));
  for (Index i = 0; i < 12; ++i) CHECK((composed[i] - stepwise[i]).norm() < 1e-14);
}

TEST_CASE("variables are numbered by their first nodes, the world first") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph given({{10, 20}, {20, 30}, {30, 40}, {40, 50}, {50, 10}});
  Priors priors;
  priors.rigs = {
      {20, 7, random.rotation()}, {40, 7, random.rotation()}, {50, -3, random.rotation()}};
  priors.fixed = {{30, random.rotation()}};
  const GroundedGraph problem(given, priors);
  CHECK(problem.frames().variable == std::vector<Index>{0, 1, 2, 1, 3});
  CHECK(problem.riding().variable == std::vector<Index>{1, 2, 0, 2, 3});
  CHECK(problem.graph().num_nodes() == 4);
  CHECK(problem.kept() == std::vector<Index>{0, 1, 2, 3, 4});
  // A fixed camera fixes its frame.
  priors.fixed = {{20, random.rotation()}};
  const GroundedGraph held(given, priors);
  CHECK(held.riding().variable == std::vector<Index>{1, 0, 2, 0, 3});
  const Rotations R = held.nodes_from(held.variables_from(random.rotations(5)));
  CHECK(R[1] == held.priors().fixed[0].world_from_node);
  const Matrix3 &C1 = priors.rigs[0].frame_from_node, &C3 = priors.rigs[1].frame_from_node;
  CHECK((R[3] - R[1] * C1.transpose() * C3).norm() < 1e-14);
}

TEST_CASE("priors that fit no graph are refused, and the message says which and why") {
  const MeasurementGraph graph({{1, 2}, {2, 3}});
  const auto refused = [&](Priors priors, PriorKind kind, NodeId node, const std::string& text) {
    try {
      const GroundedGraph problem(graph, priors);
    } catch (const InvalidPrior& error) {
      CHECK(error.kind() == kind);
      if (kind != PriorKind::down) CHECK(error.node() == node);
      CHECK(std::string(error.what()).find(text) != std::string::npos);
      return;
    }
    FAIL("accepted");
  };
  const Matrix3 I = Matrix3::Identity();
  Priors p;
  p.fixed = {{9, I}};
  refused(p, PriorKind::fixed, 9, "not in the graph");
  p.fixed = {{1, 2.0 * I}};
  refused(p, PriorKind::fixed, 1, "no rotation");
  p.fixed = {{1, I}, {1, I}};
  refused(p, PriorKind::fixed, 1, "twice");
  p.fixed = {{1, I}};
  p.absolute = {{1, I, 1.0}};
  refused(p, PriorKind::absolute, 1, "whose rotation is fixed");
  p.absolute = {{2, I, -1.0}};
  refused(p, PriorKind::absolute, 2, "the weight -1");
  p.absolute.clear();
  p.gravity = {{2, Vector3::Zero(), 1.0}};
  refused(p, PriorKind::gravity, 2, "direction");
  p.gravity.clear();
  p.rigs = {{2, 0, I}, {2, 1, I}};
  refused(p, PriorKind::rig, 2, "twice");
  p.rigs = {{1, 0, I}, {2, 0, I}};
  p.fixed = {{1, I}, {2, exp_so3({0.1, 0, 0})}};
  refused(p, PriorKind::fixed, 2, "does not fit the rig");
  p = {};
  p.down = Vector3::Zero();
  p.gravity = {{2, Vector3::UnitX(), 1.0}};
  refused(p, PriorKind::down, 0, "down");
  p = {};
  p.fixed = {{1, I}, {2, I}, {3, I}};
  CHECK_THROWS_WITH_AS(GroundedGraph(graph, p), doctest::Contains("nothing is left to solve"),
                       std::invalid_argument);
}

TEST_CASE("priors that are not numbers are refused") {
  const MeasurementGraph graph({{1, 2}, {2, 3}});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int k = 0; k < 9; ++k) {
    Matrix3 R = Matrix3::Identity();
    R(k / 3, k % 3) = nan;
    Priors fixed, absolute, rigs;
    fixed.fixed = {{1, R}};
    absolute.absolute = {{1, R, 1.0}};
    rigs.rigs = {{1, 0, R}};
    for (const Priors* priors : {&fixed, &absolute, &rigs}) {
      CHECK_THROWS_AS(GroundedGraph(graph, *priors), InvalidPrior);
    }
    Priors gravity, down;
    gravity.gravity = {{1, R.row(k / 3).transpose(), 1.0}};
    CHECK_THROWS_AS(GroundedGraph(graph, gravity), InvalidPrior);
    down.gravity = {{1, Vector3::UnitX(), 1.0}};
    down.down = R.row(k / 3).transpose();
    CHECK_THROWS_AS(GroundedGraph(graph, down), InvalidPrior);
  }
  Priors weight;
  weight.absolute = {{1, Matrix3::Identity(), nan}};
  CHECK_THROWS_AS(GroundedGraph(graph, weight), InvalidPrior);
}

TEST_CASE("weights that are too many, too few or out of bounds are refused and change nothing") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph given({{0, 1}, {1, 2}, {2, 3}, {0, 2}});
  Priors priors;
  priors.rigs = {{0, 0, random.rotation()}, {2, 0, random.rotation()}};  // edge 3 is inside
  priors.absolute = {{1, random.rotation(), 2.0}};
  priors.gravity = {{3, Vector3::UnitX(), 3.0}};
  GroundedGraph problem(given, priors);
  const std::vector<double> before = problem.graph().weights();
  const std::vector<std::vector<double>> wrong = {{}, {1.0, 1.0, 1.0}, {1.0, 1.0, 1.0, 1.0, 1.0}};
  for (const auto& weights : wrong) {
    CHECK_THROWS_AS(problem.set_weights(weights), std::invalid_argument);
  }
  CHECK_THROWS_AS(problem.set_weights({2.0, 2.0, 2.0, -1.0}), InvalidEdge);
  CHECK_THROWS_AS(problem.set_prior_weights({}, {5.0}), std::invalid_argument);
  CHECK_THROWS_AS(problem.set_prior_weights({5.0}, {}), std::invalid_argument);
  CHECK_THROWS_AS(problem.set_prior_weights({5.0, 5.0, 5.0}, {5.0}), std::invalid_argument);
  CHECK_THROWS_AS(problem.set_prior_weights({5.0}, {0.0}), InvalidPrior);
  CHECK(problem.graph().weights() == before);
  CHECK(problem.weights() == given.weights());
  CHECK(problem.priors().absolute[0].weight == 2.0);
  problem.set_weights({2.0, 3.0, 4.0, 5.0});
  problem.set_prior_weights({6.0}, {7.0});
  CHECK(problem.graph().weights() == std::vector<double>{2.0, 3.0, 4.0, 6.0, 7.0, 7.0});
  CHECK(problem.weights()[3] == 5.0);

  ReducedGraph reduced(given, Riding::alone(4), {{0, 3}});
  CHECK_THROWS_AS(reduced.set_weights({1.0}), std::invalid_argument);
  CHECK_THROWS_AS(reduced.set_other_weights({}), std::invalid_argument);
  CHECK_THROWS_AS(reduced.set_other_weights({1.0, 1.0}), std::invalid_argument);
  CHECK(!std::is_constructible_v<GroundedGraph, MeasurementGraph, Priors>);
  CHECK(!std::is_constructible_v<ReducedGraph, MeasurementGraph, Riding>);
}

TEST_CASE("fixed cameras of one frame that differ a little: the first holds it, as a rig does") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph given({{0, 1}, {1, 2}, {2, 3}});
  const Matrix3 C = random.rotation(), F = random.rotation();
  Priors priors;
  priors.rigs = {{0, 0, Matrix3::Identity()}, {2, 0, C}};
  priors.fixed = {{2, exp_so3({5e-7, 0.0, 0.0}) * F * C}, {0, F}};
  const GroundedGraph problem(given, priors);
  const Rotations R = problem.nodes_from(problem.variables_from(random.rotations(4)));
  CHECK(R[0] == problem.priors().fixed[0].world_from_node);
  CHECK((R[2] - R[0] * C).norm() < 1e-14);
}

TEST_CASE("one frame that holds all nodes leaves nothing to solve, but for the world") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph({{0, 1}, {1, 2}});
  const Rotations C = random.rotations(3);
  const Matrix3 Q = random.rotation();
  Priors priors;
  for (Index i = 0; i < 3; ++i) priors.rigs.push_back({i, 0, C[i]});
  CHECK_THROWS_WITH_AS(GroundedGraph(graph, priors), doctest::Contains("cameras of one frame"),
                       std::invalid_argument);
  priors.absolute = {{1, Q * C[1], 2.0}};
  const Solution solution = solve(graph, priors);
  CHECK(solution.certificate.verdict == Verdict::proved);
  for (Index i = 0; i < 3; ++i) CHECK((solution.rotations[i] - Q * C[i]).norm() < 1e-9);
  CHECK_THROWS_WITH_AS(solve_robust(graph, priors), doctest::Contains("cameras of one frame"),
                       std::invalid_argument);
}

TEST_CASE("directions of gravity may be of any length, priors rotations to rounding as they are") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph({{0, 1}, {1, 2}});
  for (const double length : {1e-300, 1e-200, 1.0, 1e200, 1e300}) {
    const Vector3 d = random.direction();
    const auto refined = refined_gravity(graph, {length * d, Vector3::Zero(), Vector3::Zero()}, 1);
    CHECK((refined[0] - d).norm() < 1e-15);
    CHECK((refined[1] - d).norm() < 1e-15);
    Priors priors;
    priors.gravity = {{0, length * d, 1.0}};
    CHECK((GroundedGraph(graph, priors).priors().gravity[0].down - d).norm() < 1e-15);
  }
  for (int k = 0; k < 50; ++k) {
    Priors priors;
    priors.fixed = {{0, random.rotation()}};
    const Matrix3& R = priors.fixed[0].world_from_node;
    if (orthogonality_error(R) > negligible_orthogonality_error) continue;
    CHECK(GroundedGraph(graph, priors).priors().fixed[0].world_from_node == R);
  }
}

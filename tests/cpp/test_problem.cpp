#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/lie.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Weighted, with parallel edges in both directions.
MeasurementGraph weighted_graph(Random& random, Index n, Index extra, double decades = 1.0) {
  auto measurements = test::simulate(random, test::random_connected(random, n, extra), 0.5);
  test::spread_weights(random, decades, measurements);
  return MeasurementGraph(measurements);
}

}  // namespace

TEST_CASE("the objective (3) is 6 sum w - tr(R Rt R^T) (20)") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = weighted_graph(random, 2 + random.below(10), random.below(20));
    const Rotations R = random.rotations(graph.num_nodes());
    const Eigen::MatrixXd side = test::stacked(R);
    const double trace = (side * test::dense_measurements(graph) * side.transpose()).trace();
    const double expected = 6.0 * graph.total_weight() - trace;
    REQUIRE(std::abs(objective(graph, R) - expected) < 1e-13 * graph.total_weight());
  }
}

TEST_CASE("one edge that is off by an angle costs 4 w (1 - cos(angle))") {
  Random random;
  INFO(random.replay());
  const double angle = 0.7;
  const Matrix3 R_i = random.rotation(), R_j = random.rotation();
  const Matrix3 measured = R_i.transpose() * R_j * exp_so3(angle * random.direction());
  const MeasurementGraph graph({{0, 1, measured, 2.5}});
  CHECK(objective(graph, {R_i, R_j}) ==
        doctest::Approx(4.0 * 2.5 * (1.0 - std::cos(angle))).epsilon(1e-14));
}

TEST_CASE("A_l is the sum over the edges that leave and enter l, as (10) has it") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 8, 20);
  const Rotations R = random.rotations(8);
  for (Index l = 0; l < 8; ++l) {
    Matrix3 A = Matrix3::Zero();
    for (const Edge& e : graph.edges()) {
      if (e.i == l) A -= e.weight * e.i_from_j() * R[e.j].transpose();
      if (e.j == l) A -= e.weight * e.i_from_j().transpose() * R[e.i].transpose();
    }
    CHECK((linear_cost(graph, R, l) - A).norm() < 1e-14 * A.norm());
  }
}

TEST_CASE("the objective changes with one block by 2 tr(A_l R_l)") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 8, 20);
  Rotations R = random.rotations(8);
  for (Index l = 0; l < 8; ++l) {
    const Matrix3 A = linear_cost(graph, R, l);
    const Matrix3 before = R[l];
    const double f_before = objective(graph, R);
    R[l] = random.rotation();
    const double change = objective(graph, R) - f_before;
    CHECK(change == doctest::Approx(2.0 * (A * (R[l] - before)).trace()).epsilon(1e-12));
  }
}

TEST_CASE("the gradient is that of central finite differences") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 12, 20);
  const Rotations R = random.rotations(12);
  const std::vector<Vector3> g = gradient(graph, R);
  const double h = 1e-5;
  for (Index l = 0; l < 12; ++l) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto moved_by = [&](double angle) {
        Rotations moved = R;
        moved[l] = exp_so3(angle * Vector3::Unit(axis)) * R[l];
        return objective(graph, moved);
      };
      const double difference = (moved_by(h) - moved_by(-h)) / (2.0 * h);
      CHECK(std::abs(g[l][axis] - difference) < 1e-8 * graph.degree(l));
    }
  }
}

TEST_CASE("gradients of all nodes add up to zero, as a turn of everything costs nothing") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 30, 60);
  Vector3 sum = Vector3::Zero();
  for (const Vector3& g_l : gradient(graph, random.rotations(30))) sum += g_l;
  CHECK(sum.norm() < 1e-13 * graph.total_weight());
}

TEST_CASE("the norms of the gradient are those of its definition") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 30, 60);
  const Rotations R = random.rotations(30);
  double squares = 0.0, largest = 0.0;
  const std::vector<Vector3> g = gradient(graph, R);
  for (Index l = 0; l < 30; ++l) {
    squares += g[l].squaredNorm();
    largest = std::max(largest, g[l].norm() / graph.degree(l));
  }
  const GradientNorm norm = gradient_norm(graph, R);
  CHECK(norm.absolute == doctest::Approx(std::sqrt(squares)).epsilon(1e-14));
  CHECK(norm.relative == doctest::Approx(largest).epsilon(1e-14));
}

TEST_CASE("the relative gradient does not depend on the unit of the weights, to the bounds") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 10, 20), 0.5);
  const Rotations R = random.rotations(10);
  const double expected = gradient_norm(MeasurementGraph(measurements), R).relative;
  for (const double weight : {min_weight, 1e-9, 1e9, max_weight}) {
    for (RelativeRotation& m : measurements) m.weight = weight;
    const MeasurementGraph graph(measurements);
    CAPTURE(weight);
    CHECK(gradient_norm(graph, R).relative == doctest::Approx(expected).epsilon(1e-12));
    CHECK(std::isfinite(objective_rounding(graph, objective(graph, R))));
  }
}

TEST_CASE("a node without edges adds nothing to the objective and to the gradient") {
  Random random;
  INFO(random.replay());
  const auto measurements = test::simulate(random, test::complete(4), 0.5);
  const MeasurementGraph graph(measurements);
  const MeasurementGraph with_loner(measurements, {0, 1, 2, 3, 4});
  Rotations R = random.rotations(4);
  const double f = objective(graph, R);
  const GradientNorm norm = gradient_norm(graph, R);
  R.push_back(random.rotation());
  CHECK(objective(with_loner, R) == f);
  CHECK(gradient_norm(with_loner, R).absolute == norm.absolute);
  CHECK(gradient_norm(with_loner, R).relative == norm.relative);
  CHECK(gradient(with_loner, R)[4].norm() == 0.0);
}

TEST_CASE("fixing the gauge sets the first node of each component to I and leaves the objective") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 6, 6), 0.5);
  for (RelativeRotation m : test::simulate(random, test::complete(4), 0.5)) {
    m.i += 10;
    m.j += 10;
    measurements.push_back(m);
  }
  const MeasurementGraph graph(measurements);
  const Components components = connected_components(graph);
  REQUIRE(components.size() == 2);
  const Rotations before = random.rotations(graph.num_nodes());
  Rotations R = before;
  fix_gauge(components, R);
  for (Index c = 0; c < 2; ++c) CHECK(R[components.root(c)] == Matrix3::Identity());
  CHECK(objective(graph, R) == doctest::Approx(objective(graph, before)).epsilon(1e-13));
  // Nodes of one component turn together.
  const auto relative = [](const Rotations& Q, Index i, Index j) -> Matrix3 {
    return Q[i].transpose() * Q[j];
  };
  CHECK((relative(R, 1, 5) - relative(before, 1, 5)).norm() < 1e-14);
  CHECK((relative(R, 7, 9) - relative(before, 7, 9)).norm() < 1e-14);
}

TEST_CASE("given rotations are snapped to rotations; what is further off is refused by its row") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 5, 5);
  const Rotations exact = random.rotations(5);
  Rotations rounded = exact;
  rounded[3] += 1e-5 * random.normal_matrix();
  const Rotations snapped = checked_rotations(graph, rounded);
  for (Index i = 0; i < 5; ++i) {
    CHECK((snapped[i].transpose() * snapped[i] - Matrix3::Identity()).norm() < 1e-14);
    CHECK((snapped[i] - rounded[i]).norm() < (i == 3 ? 1e-4 : 1e-14));
  }

  const double bad = std::numeric_limits<double>::quiet_NaN();
  for (const Matrix3& M : {Matrix3(Matrix3::Zero()), Matrix3(0.9 * exact[3]), Matrix3(-exact[3]),
                           Matrix3(bad * exact[3]), Matrix3(Matrix3::Constant(1e200))}) {
    Rotations wrong = exact;
    wrong[3] = M;
    CAPTURE(M);
    try {
      checked_rotations(graph, wrong);
      FAIL_CHECK("the matrix was taken");
    } catch (const InvalidRotation& error) {
      CHECK(error.node() == 3);
      CHECK(std::string(error.what()).find("node 3") != std::string::npos);
    }
  }
  CHECK_THROWS_AS(checked_rotations(graph, random.rotations(4)), std::invalid_argument);
}

TEST_CASE("two computations of one objective differ by no more than the stated rounding") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const double noise = random.power_of_ten(-12, 0);
    const auto truth = random.rotations(10);
    const auto pairs = test::random_connected(random, 10, 20);
    const MeasurementGraph graph(test::measure(random, pairs, truth, noise));
    const Matrix3 turn = random.rotation();
    Rotations turned = truth;
    for (Matrix3& R_i : turned) R_i = turn * R_i;
    const double f = objective(graph, truth), f_turned = objective(graph, turned);
    CAPTURE(noise);
    REQUIRE(std::abs(f - f_turned) <= objective_rounding(graph, f));
    if (noise > 1e-6) REQUIRE(objective_rounding(graph, f) < 1e-7 * f);  // nor is it lavish
  }
}

TEST_CASE("objective and gradient have the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = weighted_graph(random, 700, 3000, 3.0);
  const Rotations R = random.rotations(700);
  const double f = objective(graph, R, 1);
  const GradientNorm norm = gradient_norm(graph, R, 1);
  const std::vector<Vector3> g = gradient(graph, R, 1);
  for (const int num_threads : {2, 3, 7}) {
    CAPTURE(num_threads);
    CHECK(objective(graph, R, num_threads) == f);
    CHECK(gradient_norm(graph, R, num_threads).absolute == norm.absolute);
    CHECK(gradient_norm(graph, R, num_threads).relative == norm.relative);
    const std::vector<Vector3> again = gradient(graph, R, num_threads);
    CHECK(std::memcmp(again.data(), g.data(), g.size() * sizeof(Vector3)) == 0);
  }
}

TEST_CASE("residual quaternions and Davenport matrices say what matrices say, to rounding") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.0, 1e-6, 0.3, 2.0}) {
    for (const double spread : {0.0, 3.0}) {
      const MeasurementGraph graph = [&] {
        auto edges = test::simulate(random, test::random_connected(random, 12, 20), noise);
        test::spread_weights(random, spread, edges);
        return MeasurementGraph(edges);
      }();
      CAPTURE(noise);
      CAPTURE(spread);
      const Rotations R = noise < 0.1 ? shortest_path_init(graph) : random.rotations(12);
      const Quaternions q = to_quaternions(R);
      const ResidualQuaternions residuals(graph, q, 1);
      const DavenportMatrices matrices(graph, q, 1);
      const double f = objective(graph, R);
      const double rounding = 10.0 * objective_rounding(graph, f);
      CHECK(std::abs(residuals.objective() - f) <= rounding);
      CHECK(std::abs(matrices.objective() - f) <= rounding + 10.0 * matrices.objective_rounding());
      const GradientNorm norm = gradient_norm(graph, R);
      const double tiny = 1e-14 * graph.total_weight();
      CHECK(residuals.gradient_norm().absolute ==
            doctest::Approx(norm.absolute).epsilon(1e-9).scale(tiny / 1e-9));
      CHECK(matrices.gradient_norm().absolute ==
            doctest::Approx(norm.absolute).epsilon(1e-9).scale(tiny / 1e-9));
      CHECK(std::abs(matrices.gradient_norm().relative - norm.relative) <= 1e-13);
      const std::vector<Vector3> g = gradient(graph, R);
      for (Index l = 0; l < 12; ++l) {
        CHECK((residuals.gradient(l) - g[l]).norm() <= 1e-13 * graph.degree(l));
        // tr(A_l R(x)) = deg_l - 4 x^T K_l x for any unit x (10)
        const Quaternion x(random.rotation());
        const double value = (linear_cost(graph, R, l) * x.toRotationMatrix()).trace();
        const double expected = graph.degree(l) - 4.0 * x.coeffs().dot(matrices[l] * x.coeffs());
        CHECK(std::abs(value - expected) <= 1e-12 * graph.degree(l));
      }
    }
  }
}

TEST_CASE("the Hessian is the symmetrised derivative of the gradient, and 4 L without noise") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.0, 0.3, 2.0}) {
    const MeasurementGraph graph(
        test::simulate(random, test::random_connected(random, 7, 8), noise));
    const Rotations R = random.rotations(7);
    const ResidualQuaternions residuals(graph, to_quaternions(R), 1);
    const auto hessian = [&](const NodeVectors& w) {
      NodeVectors result;
      apply_hessian(residuals, w, result);
      return result;
    };
    // Along a geodesic the second derivative of f is w . H w.
    for (int k = 0; k < 5; ++k) {
      NodeVectors w(7, 3);
      for (Index i = 0; i < 7; ++i) w.row(i) = random.normal_vector().transpose();
      const auto f_at = [&](double t) {
        Rotations moved = R;
        for (Index i = 0; i < 7; ++i) moved[i] = turned(R[i], t * w.row(i).transpose());
        return objective(graph, moved);
      };
      constexpr double h = 1e-4;
      const double second = (f_at(h) - 2.0 * f_at(0.0) + f_at(-h)) / (h * h);
      CHECK(w.cwiseProduct(hessian(w)).sum() ==
            doctest::Approx(second).epsilon(1e-5).scale(graph.total_weight()));
      NodeVectors v(7, 3);
      for (Index i = 0; i < 7; ++i) v.row(i) = random.normal_vector().transpose();
      CHECK(v.cwiseProduct(hessian(w)).sum() ==
            doctest::Approx(w.cwiseProduct(hessian(v)).sum()).epsilon(1e-12).scale(100.0));
    }
    if (noise > 0.0) continue;
    const ResidualQuaternions at_truth(graph, to_quaternions(shortest_path_init(graph)), 1);
    const Components components = connected_components(graph);
    NodeVectors w(7, 3);
    for (Index i = 0; i < 7; ++i) w.row(i) = random.normal_vector().transpose();
    const Eigen::MatrixXd expected = 4.0 * apply_laplacian(graph, components, 0, w);
    NodeVectors Hw, back;
    apply_hessian(at_truth, w, Hw);
    CHECK((Hw - expected).norm() <= 1e-12 * expected.norm());
    std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
    LaplacianMetric metric(graph, eliminations);
    REQUIRE(metric.factorize({}) == CholeskyOutcome::positive_definite);
    w.row(0).setZero();
    metric.apply(NodeVectors(4.0 * apply_laplacian(graph, components, 0, w)), back);
    CHECK((back - w).norm() <= 1e-12 * w.norm());
  }
}

// The problem with full covariances: its objective, its derivatives, and the optimum.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/hessian.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/anisotropic.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/anisotropic.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::anisotropic_graph;
using rotavg::test::objective_by_definition;
using rotavg::test::Random;
using rotavg::test::residuals_at;
using rotavg::test::with_eigenvalues;

namespace {

Rotations turned_by(const Rotations& R, const NodeVectors& w, double t) {
  Rotations next = R;
  for (std::size_t i = 0; i < R.size(); ++i) {
    next[i] = exp_so3(t * w.row(static_cast<Eigen::Index>(i)).transpose()) * R[i];
  }
  return next;
}

NodeVectors random_vectors(Random& random, Index n) {
  return NodeVectors::NullaryExpr(n, 3,
                                  [&](Eigen::Index, Eigen::Index) { return random.normal(); });
}

}  // namespace

TEST_CASE("eigenvalues of 3 x 3 matrices rise and rebuild the matrix") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 2000; ++k) {
    Vector3 values(random.normal(), random.normal(), random.normal());
    if (k % 3 == 0) values(1) = values(0);
    if (k % 5 == 0) values *= 1e-120;
    const Matrix3 A = with_eigenvalues(random, values);
    const SymmetricEigen eigen = symmetric_eigen(A);
    std::sort(values.data(), values.data() + 3);
    const double scale = values.cwiseAbs().maxCoeff();
    REQUIRE((eigen.values - values).cwiseAbs().maxCoeff() <= 1e-14 * scale);
    const Matrix3 again = eigen.vectors * eigen.values.asDiagonal() * eigen.vectors.transpose();
    REQUIRE((again - A).cwiseAbs().maxCoeff() <= 1e-14 * scale);
  }
}

TEST_CASE("the objective is that of general blocks in (20), and r^T H r for small r") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const Index n = 2 + random.below(8);
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, n, random.below(12)), 0.3);
    const Rotations R = random.rotations(graph.num_nodes());
    const double f = residuals_at(graph, R).objective();
    REQUIRE(f == doctest::Approx(objective_by_definition(graph, R)).epsilon(1e-12));
  }
  const Matrix3 H = with_eigenvalues(random, {1.0, 3.0, 10.0});
  const Matrix3 R_ij = random.rotation(), R_i = random.rotation();
  const AnisotropicGraph one(MeasurementGraph({{0, 1, R_ij}}), {H});
  const Vector3 r = 1e-6 * random.direction();
  const double f = residuals_at(one, {R_i, R_i * R_ij * exp_so3(r)}).objective();
  CHECK(f == doctest::Approx(r.dot(H * r)).epsilon(1e-9));
}

TEST_CASE("gradient and Hessian are those of finite differences") {
  Random random;
  INFO(random.replay());
  const AnisotropicGraph graph =
      anisotropic_graph(random, test::random_connected(random, 7, 8), 0.3);
  const Rotations R = random.rotations(graph.num_nodes());
  const AnisotropicResiduals at = residuals_at(graph, R);
  const double h = 1e-4, scale = graph.scalar().total_weight();
  for (int k = 0; k < 10; ++k) {
    const NodeVectors w = random_vectors(random, graph.num_nodes());
    const auto f = [&](double t) { return objective_by_definition(graph, turned_by(R, w, t)); };
    double slope = 0.0;
    for (Index i = 0; i < graph.num_nodes(); ++i) slope += at.gradient(i).dot(w.row(i));
    NodeVectors Hw;
    apply_hessian(at, w, Hw);
    CHECK(std::abs((f(h) - f(-h)) / (2.0 * h) - slope) < 1e-5 * scale);
    CHECK(std::abs((f(h) + f(-h) - 2.0 * f(0.0)) / (h * h) - w.cwiseProduct(Hw).sum()) <
          1e-4 * scale);
  }
  // The blocks are those of the product.
  const Components components = connected_components(graph.scalar());
  std::vector<Elimination> eliminations = grounded_eliminations(graph.scalar(), components);
  Elimination& elimination = eliminations[0];
  const auto blocks = hessian_blocks(at, elimination);
  const auto& pattern = elimination.pattern();
  NodeVectors unit = NodeVectors::Zero(graph.num_nodes(), 3), column;
  for (Index a = 0; a < elimination.size(); ++a) {
    for (int c = 0; c < 3; ++c) {
      unit.setZero();
      unit(elimination.node(a), c) = 1.0;
      apply_hessian(at, unit, column);
      for (Index e = pattern.start[static_cast<std::size_t>(a)];
           e < pattern.start[static_cast<std::size_t>(a) + 1]; ++e) {
        const auto entry = static_cast<std::size_t>(e);
        const Vector3 expected = column.row(elimination.node(pattern.row[entry])).transpose();
        REQUIRE((blocks[entry].col(c) - expected).norm() < 1e-12 * scale);
      }
    }
  }
}

TEST_CASE("any block is a rotation and a precision") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 500; ++k) {
    Matrix3 N;
    for (int e = 0; e < 9; ++e) N(e) = random.normal();
    const BlockMeasurement m = measurement_from_block(N);
    const Matrix3 M = 0.5 * m.precision.trace() * Matrix3::Identity() - m.precision;
    REQUIRE((m.i_from_j * M - N).norm() < 1e-12 * N.norm());
    REQUIRE(symmetric_eigen(m.precision).values(0) > -1e-12 * N.norm());
  }
}

TEST_CASE("precisions h I are the weights h / 2") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 12, 20), 0.3);
  test::spread_weights(random, 1.0, measurements);
  const MeasurementGraph graph(measurements);
  std::vector<Matrix3> precisions;
  for (const Edge& e : graph.edges()) precisions.push_back(2.0 * e.weight * Matrix3::Identity());
  const AnisotropicGraph same(graph, precisions);
  const Solution isotropic = solve(graph), solution = solve(same);
  CHECK(solution.objective == doctest::Approx(isotropic.objective).epsilon(1e-9));
  CHECK(solution.certificate.verdict == Verdict::proved);
  for (std::size_t i = 0; i < solution.rotations.size(); ++i) {
    CHECK((solution.rotations[i] - isotropic.rotations[i]).norm() < 1e-7);
  }
}

TEST_CASE("BCD, SUM and Newton fall to the same optimum, which is proved") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 8, 16), 0.1);
    SolveOptions options;
    std::optional<double> f;
    for (const Method method : {Method::automatic, Method::bcd, Method::sum, Method::newton}) {
      options.method = method;
      const Solution solution = solve(graph, options);
      REQUIRE(is_converged(solution.status));
      for (std::size_t t = 1; t < solution.trace.size() && method != Method::automatic; ++t) {
        const double before = solution.trace[t - 1].objective;
        REQUIRE(solution.trace[t].objective <= before * (1.0 + 1e-12));
      }
      if (!f) f = solution.objective;
      REQUIRE(solution.objective == doctest::Approx(*f).epsilon(1e-9));
      REQUIRE(solution.certificate.verdict == Verdict::proved);
    }
    options.method = Method::sum;
    options.mu = MuRule::min_eigenvalue;
    REQUIRE(solve(graph, options).objective == doctest::Approx(*f).epsilon(1e-6));
  }
}

TEST_CASE("without noise every graph is proved, and several components are") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::grid(4, 5);
  for (const auto& [i, j] : test::cycle(6)) pairs.emplace_back(20 + i, 20 + j);
  for (const double noise : {1e-7, 1e-6, 1e-3, 0.05}) {
    const Solution solution = solve(anisotropic_graph(random, pairs, noise));
    CHECK(solution.components.size() == 2);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(solution.rotations[20] == Matrix3::Identity());
  }
}

TEST_CASE("results have the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  const AnisotropicGraph graph =
      anisotropic_graph(random, test::random_connected(random, 200, 400), 0.2);
  for (const Method method : {Method::automatic, Method::sum, Method::staircase}) {
    SolveOptions options;
    options.method = method;
    options.iteration.num_threads = 1;
    const Solution one = solve(graph, options);
    options.iteration.num_threads = 3;
    const Solution three = solve(graph, options);
    CHECK(one.rotations == three.rotations);
    CHECK(one.certificate.gap == three.certificate.gap);
  }
}

TEST_CASE("what is no precision is refused by its edge") {
  const MeasurementGraph graph({{0, 1, Matrix3::Identity()}, {1, 2, Matrix3::Identity()}});
  const Matrix3 I = Matrix3::Identity();
  Matrix3 negative = I, skew = I, nan = I;
  negative(2, 2) = -1.0;
  skew(0, 1) = 0.5;
  nan(1, 1) = std::numeric_limits<double>::quiet_NaN();
  for (const Matrix3& bad : {negative, skew, nan, Matrix3(Matrix3::Zero())}) {
    try {
      const AnisotropicGraph refused(graph, {I, bad});
      FAIL("not refused");
    } catch (const InvalidEdge& error) {
      CHECK(error.edge() == 1);
    }
  }
  CHECK_THROWS_AS(AnisotropicGraph(graph, {I}), std::invalid_argument);
  CHECK_THROWS_AS(AnisotropicGraph(graph, {I, I}, {{2, Vector3::UnitY()}}), std::invalid_argument);
  const Rotations R(3, Matrix3::Identity());
  CHECK_THROWS_AS(refine_anisotropic(graph, {I, nan}, R), InvalidEdge);
  CHECK_THROWS_AS(refine_anisotropic(graph, {I, -I}, R), InvalidEdge);
  CHECK_THROWS_AS(refine_anisotropic(graph, {I}, R), std::invalid_argument);
  CHECK_THROWS_AS(refine_anisotropic(graph, {I, I}, {I, I, 7.0 * I}), InvalidRotation);
  CHECK_THROWS_AS(refine_anisotropic(graph, {I, I}, {I, nan, I}), InvalidRotation);
  CHECK_THROWS_WITH_AS(AnisotropicGraph(graph, {I, 1e308 * I}),
                       "edge 1: the precision holds an entry of 1e+308; expected at most 1e+100",
                       InvalidEdge);
}

TEST_CASE("a turn about an axis that is not known costs nothing, however large it is") {
  // As a free heading does: the cost is that of the tilt, and none of rounding's.
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const Vector3 axis = random.direction();
    const double w = random.power_of_ten(-3.0, 3.0), tilt = random.power_of_ten(-12.0, -1.0);
    Matrix3 H = w * Matrix3::Identity();
    H -= w * outer_product(axis, axis);
    const Matrix3 i_from_j = random.rotation();
    const AnisotropicGraph graph(MeasurementGraph({{0, 1, i_from_j, 1.0}}), {symmetric_part(H)});
    // The residual turns about the axis, and then about one across.
    const Vector3 across = axis.cross(random.direction()).normalized();
    const double heading = random.uniform(-3.0, 3.0);
    const Matrix3 R_0 = random.rotation();
    const Matrix3 R_1 = R_0 * i_from_j * exp_so3(tilt * across) * exp_so3(heading * axis);
    const double cost = residuals_at(graph, {R_0, R_1}).objective();
    const double expected = 4.0 * w * std::pow(std::sin(0.5 * tilt), 2);
    CHECK(std::abs(cost - expected) <= 1e-14 * w * tilt + 1e-28 * w);
  }
}

TEST_CASE("of precisions that are singular nothing is NaN, and no objective is negative") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const test::Pairs pairs = test::random_connected(random, 6, 6);
    std::vector<Matrix3> precisions;
    for (std::size_t e = 0; e < pairs.size(); ++e) {
      precisions.push_back(test::with_eigenvalues(random, {0.0, 0.0, 100.0}));
    }
    const AnisotropicGraph graph(test::simulate_graph(random, pairs, k % 2 ? 0.0 : 1e-9),
                                 precisions);
    const Solution solution = solve(graph);
    CHECK(solution.objective >= 0.0);
    CHECK(!std::isnan(solution.certificate.gap));
    CHECK(!std::isnan(solution.certificate.relative_gap));
  }
}

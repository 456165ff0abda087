#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <Eigen/QR>

#include <rotavg/init/random.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/problem/lifted.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/staircase.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// A graph of weighted edges, some rotations, and the lifted problem in their frame.
struct Lift {
  explicit Lift(Random& random, Index n = 12)
      : graph(weighted(random, n)),
        R(random.rotations(n)),
        components(connected_components(graph)),
        residuals(graph, to_quaternions(R), 1),
        problem(residuals, components, 0) {}

  static MeasurementGraph weighted(Random& random, Index n) {
    auto measurements = test::simulate(random, test::random_connected(random, n, 2 * n), 0.5);
    test::spread_weights(random, 1.0, measurements);
    return MeasurementGraph(measurements);
  }

  MeasurementGraph graph;
  Rotations R;
  Components components;
  ResidualQuaternions residuals;
  LiftedProblem problem;
};

Eigen::MatrixXd normal(Random& random, Eigen::Index rows, Eigen::Index columns) {
  return Eigen::MatrixXd::NullaryExpr(rows, columns,
                                      [&](Eigen::Index, Eigen::Index) { return random.normal(); });
}

LiftedBlocks random_blocks(Random& random, const LiftedProblem& problem, Eigen::Index p) {
  LiftedBlocks Z(3 * problem.num_nodes(), p);
  for (Index a = 0; a < problem.num_nodes(); ++a) {
    const Eigen::MatrixXd square = normal(random, p, p);
    const Eigen::MatrixXd orthogonal = Eigen::HouseholderQR<Eigen::MatrixXd>(square).householderQ();
    Z.middleRows<3>(3 * a) = orthogonal.topRows<3>();
  }
  return Z;
}

/// Two rings that are twisted once, and a light edge that joins them if `joined`.
MeasurementGraph two_rings(Index n, bool joined) {
  std::vector<RelativeRotation> measurements;
  for (const Index first : {0, n}) {
    for (const auto& [i, j] : test::cycle(n)) measurements.push_back({first + i, first + j});
  }
  if (joined) measurements.push_back({0, n, Matrix3::Identity(), 0.01});
  return MeasurementGraph(measurements);
}

Rotations twisted_twice(Index n) {
  Rotations R = test::twisted(n, 1);
  R.insert(R.end(), R.begin(), R.end());
  return R;
}

}  // namespace

TEST_CASE("the lifted objective is sum w |Y_i R_ij - Y_j|^2, and at [I 0] that of the rotations") {
  Random random;
  INFO(random.replay());
  const Lift lift(random);
  for (const Eigen::Index p : {3, 4, 7}) {
    const LiftedBlocks Z = random_blocks(random, lift.problem, p);
    double expected = 0.0;
    for (const Edge& e : lift.graph.edges()) {
      const Eigen::MatrixXd Y_i = Z.middleRows<3>(3 * e.i).transpose() * lift.R[e.i];
      const Eigen::MatrixXd Y_j = Z.middleRows<3>(3 * e.j).transpose() * lift.R[e.j];
      expected += e.weight * (Y_i * e.i_from_j() - Y_j).squaredNorm();
    }
    CHECK(lift.problem.evaluate(Z).objective == doctest::Approx(expected).epsilon(1e-12));
  }
  CHECK(lift.problem.evaluate(lift.problem.unlifted()).objective ==
        doctest::Approx(objective(lift.graph, lift.R)).epsilon(1e-12));
}

TEST_CASE("gradient and Hessian of the lifted problem agree with differences") {
  Random random;
  INFO(random.replay());
  const Lift lift(random);
  const LiftedProblem& problem = lift.problem;
  for (const Eigen::Index p : {3, 5, 8}) {
    CAPTURE(p);
    const LiftedPoint at = problem.evaluate(random_blocks(random, problem, p));
    LiftedBlocks V = normal(random, at.Z.rows(), p), W = normal(random, at.Z.rows(), p);
    problem.project(at.Z, V);
    problem.project(at.Z, W);
    const double h = 1e-5;
    const double difference = (problem.objective(problem.retract(at.Z, h * V)) -
                               problem.objective(problem.retract(at.Z, -h * V))) /
                              (2.0 * h);
    const double slope = at.gradient.cwiseProduct(V).sum();
    CHECK(difference == doctest::Approx(slope).epsilon(1e-7));

    // Differences of the gradient, back in the tangent space.
    LiftedBlocks change = (problem.evaluate(problem.retract(at.Z, h * V)).gradient -
                           problem.evaluate(problem.retract(at.Z, -h * V)).gradient) /
                          (2.0 * h);
    problem.project(at.Z, change);
    const LiftedBlocks HV = problem.hessian(at, V);
    CHECK((change - HV).norm() < 1e-6 * HV.norm());
    // Symmetric.
    const double there = W.cwiseProduct(HV).sum();
    const double back = V.cwiseProduct(problem.hessian(at, W)).sum();
    CHECK(there == doctest::Approx(back).epsilon(1e-11));
  }
}

TEST_CASE("a step ends at blocks with orthonormal rows, and a tangent is its own projection") {
  Random random;
  INFO(random.replay());
  const Lift lift(random);
  const LiftedBlocks Z = random_blocks(random, lift.problem, 6);
  LiftedBlocks V = normal(random, Z.rows(), 6);
  lift.problem.project(Z, V);
  LiftedBlocks again = V;
  lift.problem.project(Z, again);
  CHECK((again - V).norm() < 1e-13 * V.norm());
  const LiftedBlocks next = lift.problem.retract(Z, 3.0 * V);
  for (Index a = 0; a < lift.problem.num_nodes(); ++a) {
    const auto block = next.middleRows<3>(3 * a);
    CHECK((block * block.transpose() - Matrix3::Identity()).norm() < 1e-12);
  }
}

TEST_CASE("from the twist of a ring the staircase comes down untwisted") {
  const Index n = 20;
  const MeasurementGraph graph = test::noiseless_cycle(n);
  const Rotations stuck = newton(graph, test::twisted(n, 1)).rotations;
  REQUIRE(objective(graph, stuck) > 1.0);

  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  Staircase staircase(graph, components, 0, eliminations[0], stuck, 1, 1e10, {});
  REQUIRE(staircase.climb({}));
  CHECK(staircase.rank() == Staircase::first_rank);
  CHECK(objective(graph, staircase.rounded()) < 1e-12);
  CHECK_FALSE(staircase.climb({}));  // nothing is left to gain

  const Solution solution = solve(graph, {}, test::twisted(n, 1));
  CHECK(solution.method == Method::staircase);
  CHECK(solution.objective < 1e-20);
  CHECK(solution.certificate.verdict == Verdict::proved);
}

TEST_CASE("every component climbs for itself") {
  const Index n = 16;
  for (const bool joined : {false, true}) {
    CAPTURE(joined);
    const MeasurementGraph graph = two_rings(n, joined);
    SolveOptions options;
    options.method = Method::newton;
    const Solution stuck = solve(graph, options, twisted_twice(n));
    CHECK(stuck.certificate.verdict == Verdict::not_certified);
    REQUIRE(stuck.certificate.components.size() == (joined ? 1 : 2));
    for (const ComponentCertificate& part : stuck.certificate.components) {
      CHECK(part.verdict == Verdict::not_certified);
    }
    options.method = Method::automatic;
    const Stopwatch watch;
    const Solution solution = solve(graph, options, twisted_twice(n));
    CHECK(solution.objective < 1e-18);
    CHECK(solution.certificate.verdict == Verdict::proved);
    // The way up counts.
    const Timings& told = solution.timings;
    CHECK(told.init + told.solve + told.certify > 0.3 * watch.seconds());
    for (const ComponentCertificate& part : solution.certificate.components) {
      CHECK(part.verdict == Verdict::proved);
    }
  }
}

TEST_CASE("a component that does not improve does not hold the others back") {
  // A ring that untwists, one whose relaxation is not tight, and one that is at its optimum.
  Random random;
  INFO(random.replay());
  const Index n = 12;
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : test::cycle(n)) measurements.push_back({i, j});
  for (const auto& [i, j] : test::complete(5)) {
    measurements.push_back({100 + i, 100 + j, random.rotation()});
  }
  for (const auto& [i, j] : test::cycle(n)) measurements.push_back({200 + i, 200 + j});
  const MeasurementGraph graph(measurements);
  Rotations start = test::twisted(n, 1);
  start.resize(graph.nodes().size(), Matrix3::Identity());
  SolveOptions options;
  options.max_rank = 0;
  const Solution stuck = solve(graph, options, start);
  options.max_rank = 10;
  const Solution solution = solve(graph, options, start);
  REQUIRE(solution.certificate.components.size() == 3);
  CHECK(stuck.certificate.components[0].verdict == Verdict::not_certified);
  CHECK(solution.certificate.components[0].verdict == Verdict::proved);
  CHECK(solution.certificate.components[2].verdict == Verdict::proved);
  CHECK(solution.objective < stuck.objective - 0.1);
  CHECK(solution.certificate.gap >= -1e-12);
}

TEST_CASE("rounding turns a reflected lift round") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(5, 5), 0.1);
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  int climbs = 0;
  for (int start = 0; start < 20; ++start) {
    Staircase staircase(graph, components, 0, eliminations[0], random.rotations(25), 1, 1e10, {});
    if (!staircase.climb({})) continue;
    ++climbs;
    for (const Matrix3& R : staircase.rounded()) {
      CHECK(R.determinant() == doctest::Approx(1.0));
    }
    CHECK(objective(graph, newton(graph, staircase.rounded()).rotations) ==
          doctest::Approx(solve(graph).objective).epsilon(1e-9));
  }
  CHECK(climbs > 0);
}

TEST_CASE("the bound from the relaxation is met from below, and S agrees with a dense matrix") {
  Random random;
  INFO(random.replay());
  int not_tight = 0;
  for (int trial = 0; trial < 30; ++trial) {
    CAPTURE(trial);
    const Index n = 8 + random.below(20);
    const MeasurementGraph graph =
        test::simulate_graph(random, test::random_connected(random, n, n), 1.2);
    const Solution solution = solve(graph);
    REQUIRE(is_converged(solution.status));
    // No rotations beat what is left of the objective; here, those of twenty other starts.
    const double lower = solution.objective - solution.certificate.gap;
    double best = solution.objective;
    for (int start = 0; start < 20; ++start) {
      best = std::min(best, newton(graph, random.rotations(n)).objective);
    }
    CHECK(lower <= best * (1.0 + 1e-12));
    if (solution.certificate.verdict == Verdict::proved) {
      CHECK(best >= solution.objective * (1.0 - 1e-9));
      continue;
    }
    ++not_tight;
    CHECK(solution.certificate.method == CertificateMethod::relaxation);
    CHECK(lower > 0.0);
    // The plain bound of S at the rotations is worse.
    const double lambda_min =
        test::dense_eigenvalues(test::dense_certificate_matrix(graph, solution.rotations))(0);
    CHECK(lambda_min < 0.0);
    CHECK(solution.certificate.gap <= -3.0 * n * lambda_min);
  }
  CHECK(not_tight > 0);  // or the noise is too small for this test to say anything
}

TEST_CASE("that the relaxation is not tight is told only where its optimum was met") {
  // What is known is a bound, whether it is the optimum or not.
  ComponentBound refuted;
  refuted.lambda_min = -0.1;
  refuted.gap = 5.0;
  detail::Measure measure;
  measure.objective = 2.0;
  measure.weight = 1.0;
  for (const bool met : {false, true}) {
    const LowerBound known{1.5, CertificateMethod::relaxation, met};
    const auto certificate = detail::certify_component(refuted, known, measure, 1e-6);
    CHECK(certificate.gap == doctest::Approx(0.5));
    CHECK(certificate.shortfall == (met ? Shortfall::relaxation : Shortfall::negative));
  }
}

TEST_CASE("limits hold on the staircase, too") {
  const Index n = 30;
  const MeasurementGraph graph = test::noiseless_cycle(n);
  SolveOptions options;
  options.max_rank = 4;  // below the first step
  CHECK(solve(graph, options, test::twisted(n, 1)).certificate.verdict == Verdict::not_certified);
  options.max_rank = 10;
  options.iteration.time_limit = 0.0;
  CHECK(solve(graph, options, test::twisted(n, 1)).certificate.verdict == Verdict::not_certified);
  options.iteration.time_limit = 1e9;
  // Wherever it is interrupted, the certificate is that of the rotations, or there is none.
  for (int stop = 1; stop < 400; stop += 1 + stop / 10) {
    int asked = 0;
    options.iteration.keep_going = [&] { return ++asked < stop; };
    const Solution stopped = solve(graph, options, test::twisted(n, 1));
    for (const Matrix3& R : stopped.rotations) REQUIRE(R.allFinite());
    if (stopped.certificate.verdict == Verdict::not_run) continue;
    const double f = objective(graph, stopped.rotations);  // and f* = 0
    CAPTURE(stop);
    CHECK(stopped.certificate.gap >= f * (1.0 - 1e-9));
    if (f < 1e-12) CHECK(stopped.certificate.gap < 1.0);
  }
}

TEST_CASE("the method staircase needs no good start") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(12, 12), 0.1);
  const Solution expected = solve(graph);
  REQUIRE(expected.certificate.verdict == Verdict::proved);
  SolveOptions options;
  options.method = Method::staircase;
  options.init = Initialization::random;
  for (options.seed = 0; options.seed < 5; ++options.seed) {
    const Solution solution = solve(graph, options);
    CHECK(solution.objective == doctest::Approx(expected.objective).epsilon(1e-10));
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(static_cast<int>(solution.trace.size()) == solution.iterations + 1);
  }
}

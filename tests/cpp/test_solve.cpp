#include <cmath>
#include <stdexcept>
#include <string>

#include <doctest/doctest.h>

#include <rotavg/rotavg.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

TEST_CASE("solve finds the optimum, proves it and sets the first node of each component to I") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::complete(12), 0.3);
  for (RelativeRotation m : test::simulate(random, test::random_connected(random, 15, 30), 0.1)) {
    m.i += 100;
    m.j += 100;
    measurements.push_back(m);
  }
  const MeasurementGraph graph(measurements);
  for (const Method method : {Method::automatic, Method::bcd, Method::sum}) {
    for (const MuRule mu : {MuRule::adaptive, MuRule::min_eigenvalue}) {
      SolveOptions options;
      options.method = method;
      options.mu = mu;
      const Solution solution = solve(graph, options);
      CHECK(is_converged(solution.status));
      CHECK(solution.certificate.verdict == Verdict::proved);
      CHECK(solution.components.size() == 2);
      CHECK(solution.rotations[0] == Matrix3::Identity());
      CHECK(solution.rotations[12] == Matrix3::Identity());
      CHECK(solution.method != Method::automatic);
      CHECK(solution.init == Initialization::shortest_path);
      // Evaluated where it is returned, gauge and all.
      const double f = objective(graph, solution.rotations);
      CHECK(std::abs(solution.objective - f) <= 4.0 * objective_rounding(graph, f));
      CHECK(gradient_norm(graph, solution.rotations).relative < 2e-9);
    }
  }
}

TEST_CASE("solve refutes the twisted cycle that it is started from, and leaves it otherwise") {
  const MeasurementGraph graph = test::noiseless_cycle(20);
  SolveOptions without_staircase;
  without_staircase.max_rank = 0;
  const Solution stuck = solve(graph, without_staircase, test::twisted(20, 1));
  CHECK(stuck.iterations == 0);
  CHECK(stuck.status == Status::gradient_converged);
  CHECK(stuck.certificate.verdict == Verdict::not_certified);
  CHECK(stuck.certificate.lambda_min < -0.05);
  CHECK(solve(graph).certificate.verdict == Verdict::proved);
}

TEST_CASE("a warm start and a random start are used as such") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(10), 0.2);
  const Solution cold = solve(graph);
  CHECK(cold.iterations > 0);
  CHECK(solve(graph, {}, cold.rotations).iterations == 0);

  SolveOptions options;
  options.init = Initialization::random;
  options.seed = 11;
  options.iteration.max_iterations = 0;
  const Solution random_start = solve(graph, options);
  CHECK(random_start.status == Status::iteration_limit);
  const double f = objective(graph, random_init(graph, 11));
  CHECK(random_start.objective == doctest::Approx(f).epsilon(1e-12));
  CHECK(random_start.certificate.verdict == Verdict::not_certified);
}

TEST_CASE("a run that a callback stops is certified, an interrupted one is not") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(10), 0.2);
  SolveOptions options;
  options.iteration.callback = [](const Progress&) { return false; };
  CHECK(solve(graph, options).status == Status::stopped);
  CHECK(solve(graph, options).certificate.verdict == Verdict::not_certified);
  CHECK(solve(graph, options).certificate.method == CertificateMethod::factorization);

  SolveOptions interrupted;
  interrupted.iteration.keep_going = [] { return false; };
  CHECK(solve(graph, interrupted).status == Status::stopped);
  CHECK(solve(graph, interrupted).certificate.verdict == Verdict::not_run);

  SolveOptions out_of_time;
  out_of_time.iteration.time_limit = 0.0;
  const Solution solution = solve(graph, out_of_time);
  CHECK(solution.status == Status::time_limit);
  CHECK(solution.certificate.verdict == Verdict::not_certified);
  CHECK(solution.certificate.method == CertificateMethod::none);

  SolveOptions uncertified;
  uncertified.certify = false;
  CHECK(solve(graph, uncertified).certificate.verdict == Verdict::not_run);
}

TEST_CASE("a start of the wrong size is refused with both numbers") {
  const MeasurementGraph graph = test::noiseless_cycle(5);
  CHECK_THROWS_WITH_AS(solve(graph, {}, test::twisted(4, 0)),
                       "found 4 rotations; expected 5, one for each node", std::invalid_argument);
}

TEST_CASE("the version's parts make the version") {
  const std::string version = std::to_string(ROTAVG_VERSION_MAJOR) + "." +
                              std::to_string(ROTAVG_VERSION_MINOR) + "." +
                              std::to_string(ROTAVG_VERSION_PATCH);
  CHECK(version == ROTAVG_VERSION);
}

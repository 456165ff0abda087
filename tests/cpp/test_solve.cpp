#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/init/random.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/rotavg.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/newton.hpp>

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

TEST_CASE("sweeps solve random graphs, whose Laplacian fills in, and Newton's method lattices") {
  Random random;
  INFO(random.replay());
  const auto solved_by = [&](const MeasurementGraph& graph) {
    const Solution solution = solve(graph);
    CHECK(solution.certificate.verdict == Verdict::proved);
    SolveOptions newton;
    newton.method = Method::newton;
    CHECK(solution.objective == doctest::Approx(solve(graph, newton).objective).epsilon(1e-12));
    return solution.method;
  };
  const Index n = 2000;
  CHECK(solved_by(test::simulate_graph(random, test::random_connected(random, n, 3 * n), 0.05)) ==
        Method::bcd);
  CHECK(solved_by(test::simulate_graph(random, test::grid(30, 30), 0.05)) == Method::newton);
}

TEST_CASE("the world that all nodes of a lattice know does not make it look like a random graph") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(30, 30), 0.05);
  const Rotations R = solve(graph).rotations;
  Priors priors;
  for (std::size_t i = 0; i < R.size(); ++i) {
    priors.absolute.push_back({graph.nodes()[i], R[i], 0.01});
  }
  const Solution solution = solve(graph, priors);
  CHECK(solution.method == Method::newton);
  CHECK(solution.certificate.method == CertificateMethod::factorization);
  CHECK(solution.certificate.verdict == Verdict::proved);
}

TEST_CASE("where Newton's method has ended, polishing goes on by it, on graphs that fill in, too") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 2000, 4000), 1e-7);
  test::spread_weights(random, 1.0, measurements);
  SolveOptions options;
  options.iteration.tolerance = 1e-2;  // so that something is left to do for the proof
  const Solution solution = solve(MeasurementGraph(measurements), options);
  CHECK(solution.certificate.verdict == Verdict::proved);
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

TEST_CASE("numbers out of range are refused by whatever solves or certifies") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(6), 0.2);
  const AnisotropicGraph anisotropic(graph, std::vector<Matrix3>(15, Matrix3::Identity()));
  const Rotations R = solve(graph).rotations;
  Priors priors;
  priors.absolute.push_back({2, R[2], 1.0});
  const auto refused = [&](const SolveOptions& options) {
    CHECK_THROWS_AS(solve(graph, options), std::invalid_argument);
    CHECK_THROWS_AS(solve(graph, priors, options), std::invalid_argument);
    CHECK_THROWS_AS(solve(GroundedGraph(graph, priors), options, R, true), std::invalid_argument);
    CHECK_THROWS_AS(solve(anisotropic, options), std::invalid_argument);
    CHECK_THROWS_AS(solve_robust(graph, options), std::invalid_argument);
    CHECK_THROWS_AS(solve_robust(graph, priors, options), std::invalid_argument);
    CHECK_THROWS_AS(solve_rigs(graph, {}, {}, options), std::invalid_argument);
  };
  const double nan = std::nan("");
  for (const double bad : {-1.0, nan}) {
    SolveOptions options;
    options.iteration.time_limit = bad;
    refused(options);
    options = {};
    options.iteration.tolerance = bad;
    refused(options);
    options = {};
    options.certificate.tolerance = bad;
    refused(options);
    CHECK_THROWS_AS(certify(graph, R, options.certificate), std::invalid_argument);
    CHECK_THROWS_AS(certify(anisotropic, R, options.certificate), std::invalid_argument);
  }
  for (const double bad : {-1.0, 1.0, 2.0, nan}) {
    SolveOptions options;
    options.certificate.failure_probability = bad;
    refused(options);
    CHECK_THROWS_AS(certify(graph, R, options.certificate), std::invalid_argument);
  }
  SolveOptions options;
  options.iteration.max_iterations = -1;
  refused(options);
}

TEST_CASE("once a callback has returned false it is not called again, whatever is solved") {
  Random random;
  INFO(random.replay());
  const auto pairs = test::random_connected(random, 20, 60);
  const MeasurementGraph graph = simulate_graph(random, pairs, 0.3);
  std::vector<Matrix3> precisions;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    precisions.push_back(Vector3(1.0, 1.0, 40.0).asDiagonal());
  }
  const AnisotropicGraph anisotropic(graph, precisions);
  Priors priors;
  Rigs rigs;
  for (NodeId node = 0; node < 20; ++node) {
    priors.gravity.push_back({node, random.direction(), 1.0});
    rigs.images.push_back({node, node / 2, node % 2});
  }
  Rigs calibrated = rigs;
  calibrated.known = {{0, Matrix3::Identity()}, {1, exp_so3({0.0, 0.3, 0.0})}};
  const RobustOptions cauchy = [] {
    RobustOptions robust;
    robust.loss = Loss::cauchy;
    return robust;
  }();
  using Call = std::function<Solution(const SolveOptions&)>;
  const std::vector<Call> calls = {
      [&](const SolveOptions& o) { return solve(graph, o); },
      [&](const SolveOptions& o) { return solve(graph, priors, o); },
      [&](const SolveOptions& o) { return solve(anisotropic, o); },
      [&](const SolveOptions& o) { return Solution(solve_rigs(graph, rigs, {}, o)); },
      [&](const SolveOptions& o) { return Solution(solve_rigs(graph, calibrated, {}, o)); },
      [&](const SolveOptions& o) { return Solution(solve_robust(graph, o)); },
      [&](const SolveOptions& o) { return Solution(solve_robust(graph, priors, o)); },
      [&](const SolveOptions& o) { return Solution(solve_rigs(graph, rigs, {}, o, cauchy)); },
  };
  for (std::size_t which = 0; which < calls.size(); ++which) {
    CAPTURE(which);
    for (const bool certify : {true, false}) {
      CAPTURE(certify);
      int told = 0;
      SolveOptions options;
      options.certify = certify;
      options.iteration.callback = [&](const Progress&) { return ++told > 0; };
      calls[which](options);
      const int all = told;
      const auto stopped_at = [&](int stop) {
        told = 0;
        options.iteration.callback = [&](const Progress&) { return ++told != stop; };
        const Solution solution = calls[which](options);
        CHECK(told == stop);
        return solution;
      };
      for (int stop = 1; stop < all; stop += 1 + all / 40) {
        CAPTURE(stop);
        const Solution solution = stopped_at(stop);
        const bool proved = solution.certificate.verdict == Verdict::proved;
        if (!proved) CHECK(solution.status == Status::stopped);
      }
      // Nothing was to follow, but of sensors that are found (a bound, and weights made anew), and
      // where no proof may mean another run.
      const Solution last = stopped_at(all);
      const bool unproved = last.certificate.verdict != Verdict::proved;
      const bool more = which == 7 || (certify && (which == 3 || unproved));
      CHECK(last.status == (more ? Status::stopped : Status::gradient_converged));
    }
  }
}

TEST_CASE("a callback that returns false ends all runs, and counts through all of them") {
  Random random;
  INFO(random.replay());
  const Index n = 30;
  const MeasurementGraph graph = test::noiseless_cycle(n);
  const Rotations start = test::perturbed(random, test::twisted(n, 1), 0.05);
  std::size_t most = 0;
  for (std::size_t allowed = 1; allowed < 40; ++allowed) {
    CAPTURE(allowed);
    std::vector<Progress> told;
    SolveOptions options;
    options.iteration.callback = [&](const Progress& progress) {
      told.push_back(progress);
      return told.size() < allowed;
    };
    const Solution solution = solve(graph, options, start);
    REQUIRE(told.size() <= allowed);
    for (std::size_t k = 1; k < told.size(); ++k) {
      CHECK(told[k].iteration > told[k - 1].iteration);
      CHECK(told[k].seconds >= told[k - 1].seconds);
    }
    const bool proved = solution.certificate.verdict == Verdict::proved;
    if (told.size() == allowed && !proved) CHECK(solution.status == Status::stopped);
    if (told.size() < allowed) CHECK(proved);
    most = std::max(most, told.size());
  }
  CHECK(most < 39);  // or the last runs were not met
}

TEST_CASE("interrupted in the middle of a step, no solver says that it has converged") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(6, 6), 0.3);
  const Rotations start = random.rotations(graph.num_nodes());
  const std::vector<Matrix3> information(graph.edges().size(), Matrix3::Identity());
  for (int stop = 1; stop < 60; ++stop) {
    CAPTURE(stop);
    int asked = 0;
    IterationOptions options;
    options.keep_going = [&] { return ++asked != stop; };  // once, as a flag that is read and reset
    const auto check = [&](auto&& solver) {
      asked = 0;
      const IterationResult result = solver();
      if (result.status == Status::gradient_converged) CHECK(result.relative_gradient <= 1e-9);
      if (result.status == Status::step_converged) CHECK(result.relative_gradient <= 1e-6);
    };
    for (const StopRule rule : {StopRule::gradient, StopRule::step}) {
      options.stop = rule;
      check([&] { return bcd(graph, start, options); });
      check([&] { return newton(graph, start, options); });
      check([&] { return refine_anisotropic(graph, information, start, options); });
    }
  }
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

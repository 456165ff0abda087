#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/loso.hpp>
#include <rotavg/solve/accelerated.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/sum.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

struct Solver {
  std::string name;
  std::function<IterationResult(const MeasurementGraph&, Rotations, const IterationOptions&)> run;
};

const std::vector<Solver>& solvers() {
  static const std::vector<Solver> all = {
      {"BCD", [](const auto& graph, auto R,
                 const auto& options) { return bcd(graph, std::move(R), options); }},
      {"SUM, adaptive mu",
       [](const auto& graph, auto R, const auto& options) {
         return sum(graph, std::move(R), options, MuRule::adaptive);
       }},
      {"SUM, mu = -lambda_min",
       [](const auto& graph, auto R, const auto& options) {
         return sum(graph, std::move(R), options, MuRule::min_eigenvalue);
       }},
      {"BCD, accelerated",
       [](const auto& graph, auto R, const auto& options) {
         return accelerated_bcd(graph, std::move(R), options);
       }},
      {"SUM, accelerated",
       [](const auto& graph, auto R, const auto& options) {
         return accelerated_sum(graph, std::move(R), options);
       }},
      {"Newton", [](const auto& graph, auto R,
                    const auto& options) { return newton(graph, std::move(R), options); }},
  };
  return all;
}

/// Shapes on which descent has different difficulties; grids, trees, even cycles are bipartite.
std::vector<test::Pairs> shapes(Random& random) {
  test::Pairs bipartite;  // complete: the spectrum of Rt is symmetric about zero
  for (Index i = 0; i < 6; ++i) {
    for (Index j = 6; j < 12; ++j) bipartite.emplace_back(i, j);
  }
  return {test::path(2),
          test::path(3),
          test::complete(3),
          test::complete(20),
          test::cycle(4),
          test::cycle(15),
          test::grid(5, 6),
          bipartite,
          test::random_connected(random, 30, 0),
          test::random_connected(random, 30, 40)};
}

bool same_bits(const Rotations& A, const Rotations& B) {
  return A.size() == B.size() && std::memcmp(A.data(), B.data(), A.size() * sizeof(Matrix3)) == 0;
}

double worst_orthogonality(const Rotations& R) {
  double worst = 0.0;
  for (const Matrix3& R_i : R) {
    worst = std::max(worst, (R_i.transpose() * R_i - Matrix3::Identity()).cwiseAbs().maxCoeff());
  }
  return worst;
}

}  // namespace

TEST_CASE("every step of every solver lowers the objective, up to its rounding") {
  Random random;
  INFO(random.replay());
  IterationOptions options;
  options.tolerance = 0.0;
  options.max_iterations = 200;
  for (const test::Pairs& pairs : shapes(random)) {
    for (const double noise : {0.0, 0.2, 2.0}) {
      for (const double decades : {0.0, 3.0}) {
        auto measurements = test::simulate(random, pairs, noise);
        test::spread_weights(random, decades, measurements);
        const MeasurementGraph graph(measurements);
        const Rotations anywhere = random.rotations(graph.num_nodes());
        for (const Rotations& start : {anywhere, shortest_path_init(graph)}) {
          for (const Solver& solver : solvers()) {
            const IterationResult result = solver.run(graph, start, options);
            CAPTURE(solver.name);
            CAPTURE(graph.num_nodes());
            CAPTURE(graph.num_edges());
            CAPTURE(noise);
            CAPTURE(decades);
            REQUIRE(result.trace.size() == static_cast<std::size_t>(result.iterations) + 1);
            for (std::size_t k = 1; k < result.trace.size(); ++k) {
              const double before = result.trace[k - 1].objective;
              CAPTURE(k);
              // SUM's objective is a difference, good to 1e-9 of itself (DavenportMatrices).
              const double rounding = 4.0 * objective_rounding(graph, before) + 1e-9 * before;
              REQUIRE(result.trace[k].objective <= before + rounding);
            }
          }
        }
      }
    }
  }
}

TEST_CASE("from random starts every solver ends at a stationary point, on bipartite graphs too") {
  Random random;
  INFO(random.replay());
  for (const test::Pairs& pairs : shapes(random)) {
    const MeasurementGraph graph = simulate_graph(random, pairs, 0.3);
    const Rotations start = random.rotations(graph.num_nodes());
    for (const Solver& solver : solvers()) {
      const IterationResult result = solver.run(graph, start, {});
      CAPTURE(solver.name);
      CAPTURE(graph.num_nodes());
      CAPTURE(graph.num_edges());
      CHECK(result.status == Status::gradient_converged);
      CHECK(gradient_norm(graph, result.rotations).relative <= 1e-9);
      CHECK(worst_orthogonality(result.rotations) < 1e-14);
    }
  }
}

TEST_CASE("at the paper's settings, n = 20, BCD and SUM end at one objective, proved optimal") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.2, 0.5}) {
    for (const double dropped : {0.0, 0.3}) {
      for (int run = 0; run < 20; ++run) {
        const MeasurementGraph graph = test::paper_graph(random, 20, noise, dropped);
        const Rotations start = shortest_path_init(graph);
        const IterationResult by_bcd = bcd(graph, start);
        CAPTURE(noise);
        CAPTURE(dropped);
        CAPTURE(run);
        CHECK(by_bcd.status == Status::gradient_converged);
        CHECK(certify(graph, by_bcd.rotations).verdict == Verdict::proved);
        for (const MuRule rule : {MuRule::adaptive, MuRule::min_eigenvalue}) {
          const IterationResult by_sum = sum(graph, start, {}, rule);
          CHECK(by_sum.status == Status::gradient_converged);
          CHECK(by_sum.objective == doctest::Approx(by_bcd.objective).epsilon(1e-9));
          CHECK(certify(graph, by_sum.rotations).verdict == Verdict::proved);
        }
      }
    }
  }
}

TEST_CASE("the stationary point is that of the paper: R_l minimises tr(A_l R_l) for every l") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::paper_graph(random, 20, 0.5, 0.3);
  IterationOptions options;
  options.tolerance = 1e-12;
  const Rotations R = bcd(graph, shortest_path_init(graph), options).rotations;
  for (Index l = 0; l < 20; ++l) {
    CHECK((R[l] - loso(linear_cost(graph, R, l))).norm() < 1e-10);
  }
}

TEST_CASE("everything that is returned is evaluated at the rotations that are returned") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::grid(6, 6), 0.3);
  const Rotations start = random.rotations(graph.num_nodes());
  for (const int max_iterations : {0, 1, 7, 100000}) {
    IterationOptions options;
    options.max_iterations = max_iterations;
    for (const Solver& solver : solvers()) {
      const IterationResult result = solver.run(graph, start, options);
      const GradientNorm norm = gradient_norm(graph, result.rotations);
      CAPTURE(solver.name);
      CAPTURE(max_iterations);
      // Up to rounding, as the solvers work on quaternions.
      const double f = objective(graph, result.rotations), at_start = objective(graph, start);
      CHECK(std::abs(result.objective - f) <= 1e-14 * graph.total_weight());
      CHECK(std::abs(result.gradient_norm - norm.absolute) <= 1e-14 * graph.total_weight());
      CHECK(std::abs(result.relative_gradient - norm.relative) <= 1e-14);
      CHECK(std::abs(result.trace.front().objective - at_start) <= 1e-14 * graph.total_weight());
      // SUM iterates by differences of large sums, and returns what is summed edge by edge.
      const double summed = std::string(solver.name).find("SUM") == std::string::npos ? 0.0 : 1e-14;
      CHECK(std::abs(result.trace.back().objective - result.objective) <=
            summed * graph.total_weight());
      CHECK(result.trace.back().gradient_norm == result.gradient_norm);
      CHECK(result.trace.back().iteration == result.iterations);
      CHECK(result.seconds >= result.trace.back().seconds);
      if (max_iterations == 0) CHECK(same_bits(result.rotations, start));
    }
  }
}

TEST_CASE("a solver that starts at the optimum does nothing") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(15), 0.3);
  IterationOptions tight;
  tight.tolerance = 1e-12;
  const Rotations optimum = bcd(graph, shortest_path_init(graph), tight).rotations;
  for (const Solver& solver : solvers()) {
    const IterationResult result = solver.run(graph, optimum, {});
    CAPTURE(solver.name);
    CHECK(result.iterations == 0);
    CHECK(result.status == Status::gradient_converged);
    CHECK(same_bits(result.rotations, optimum));
  }
}

TEST_CASE("the paper's stopping rule compares its own measure of the step") {
  Random random;
  INFO(random.replay());
  const test::Pairs pairs = test::random_connected(random, 20, 30);
  const MeasurementGraph graph = simulate_graph(random, pairs, 0.3);
  const Rotations start = random.rotations(20);
  const double eps = 1e-6;
  for (const Solver& solver : solvers()) {
    IterationOptions options;
    options.stop = StopRule::step;
    options.tolerance = eps;
    const IterationResult result = solver.run(graph, start, options);
    CAPTURE(solver.name);
    CHECK(result.status == Status::step_converged);
    REQUIRE(result.iterations >= 2);
    CHECK(result.trace.front().step == 0.0);
    CHECK(result.trace.back().step < eps);
    for (int k = 1; k < result.iterations; ++k) CHECK(result.trace[k].step >= eps);

    // The last step again, from the iterate before it.
    options.tolerance = 0.0;
    options.max_iterations = result.iterations - 1;
    const Rotations before = solver.run(graph, start, options).rotations;
    double sum_of_relative = 0.0, squares = 0.0, size = 0.0;
    for (std::size_t k = 0; k < before.size(); ++k) {
      const Matrix3 change = result.rotations[k] - before[k];
      sum_of_relative += change.norm() / result.rotations[k].norm();
      squares += change.squaredNorm();
      size += result.rotations[k].squaredNorm();
    }
    const bool is_bcd = solver.name.rfind("BCD", 0) == 0;
    const double expected = is_bcd ? sum_of_relative : std::sqrt(squares / size);
    CHECK(result.trace.back().step == doctest::Approx(expected).epsilon(1e-12));
  }
}

TEST_CASE("every way to stop early has its status, before anything else is tried") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::grid(6, 6), 0.3);
  const Rotations start = random.rotations(36);
  for (const Solver& solver : solvers()) {
    CAPTURE(solver.name);
    const auto status_with = [&](auto&& change) {
      IterationOptions options;
      change(options);
      return solver.run(graph, start, options);
    };
    const auto limited = status_with([](auto& o) { o.max_iterations = 3; });
    CHECK(limited.status == Status::iteration_limit);
    CHECK(limited.iterations == 3);
    CHECK(!is_converged(limited.status));

    const auto out_of_time = status_with([](auto& o) { o.time_limit = 0.0; });
    CHECK(out_of_time.status == Status::time_limit);
    CHECK(out_of_time.iterations == 0);
    CHECK(same_bits(out_of_time.rotations, start));

    int calls = 0;
    const auto stopped = status_with([&](auto& o) {
      o.callback = [&](const Progress& p) {
        CHECK(p.iteration == calls++);
        return p.iteration < 4;
      };
    });
    CHECK(stopped.status == Status::stopped);
    CHECK(stopped.iterations == 4);
    CHECK(calls == 5);

    const auto interrupted = status_with([](auto& o) { o.keep_going = [] { return false; }; });
    CHECK(interrupted.status == Status::stopped);
    CHECK(interrupted.iterations == 0);

    const auto converged =
        status_with([](auto& o) { o.tolerance = std::numeric_limits<double>::infinity(); });
    CHECK(converged.status == Status::gradient_converged);
    CHECK(is_converged(converged.status));
  }
}

TEST_CASE("results have the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      simulate_graph(random, test::random_connected(random, 800, 60000), 0.3);
  REQUIRE(resolve_num_threads(7, graph.num_edges()) == 7);  // threads are used at this size
  const Rotations start = random.rotations(800);
  for (const Solver& solver : solvers()) {
    IterationOptions options;
    options.max_iterations = 20;
    options.num_threads = 1;
    const IterationResult one = solver.run(graph, start, options);
    for (const int num_threads : {2, 3, 7}) {
      options.num_threads = num_threads;
      const IterationResult other = solver.run(graph, start, options);
      CAPTURE(solver.name);
      CAPTURE(num_threads);
      CHECK(same_bits(one.rotations, other.rotations));
      CHECK(one.objective == other.objective);
      CHECK(one.gradient_norm == other.gradient_norm);
      CHECK(one.iterations == other.iterations);
    }
  }
}

TEST_CASE("a node without edges keeps its rotation") {
  Random random;
  INFO(random.replay());
  const auto measurements = test::simulate(random, test::complete(4), 0.3);
  const MeasurementGraph graph(measurements, {0, 1, 7, 2, 3});
  const Rotations start = random.rotations(5);
  for (const Solver& solver : solvers()) {
    CAPTURE(solver.name);
    const IterationResult result = solver.run(graph, start, {});
    CHECK(result.status == Status::gradient_converged);
    CHECK(result.rotations[2] == start[2]);
  }
}

TEST_CASE("the solvers do not depend on the unit of the weights") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 15, 20), 0.3);
  const Rotations start = random.rotations(15);
  for (const Solver& solver : solvers()) {
    for (RelativeRotation& m : measurements) m.weight = 1.0;
    const IterationResult one = solver.run(MeasurementGraph(measurements), start, {});
    for (const double weight : {std::ldexp(1.0, -300), std::ldexp(1.0, 300)}) {
      for (RelativeRotation& m : measurements) m.weight = weight;
      const IterationResult other = solver.run(MeasurementGraph(measurements), start, {});
      CAPTURE(solver.name);
      CAPTURE(weight);
      CHECK(other.status == Status::gradient_converged);
      CHECK(other.iterations == one.iterations);
      CHECK(other.objective / weight == doctest::Approx(one.objective).epsilon(1e-9));
    }
  }
}

TEST_CASE("the estimate of lambda_min(Rt) is a lower bound, close to the dense eigenvalue") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Index n = 2 + random.below(30);
    const double noise = k % 3 == 0 ? 0.0 : 1.0;  // without noise every eigenvalue is threefold
    auto measurements = test::simulate(random, test::random_connected(random, n, n), noise);
    test::spread_weights(random, k % 2, measurements);
    const MeasurementGraph graph(measurements);
    double max_degree = 0.0;
    for (Index i = 0; i < n; ++i) max_degree = std::max(max_degree, graph.degree(i));
    const double exact = test::dense_eigenvalues(test::dense_measurements(graph))(0);
    const double estimate = min_eigenvalue_of_measurements(graph, 1);
    CAPTURE(n);
    CAPTURE(noise);
    REQUIRE(estimate <= exact + 1e-14 * max_degree);
    REQUIRE(estimate >= exact - 1e-3 * max_degree);
  }
}

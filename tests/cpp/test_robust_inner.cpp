// The steps of one reweighting.

#include <cstddef>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/irls.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/reweighted_sweep.hpp>
#include <rotavg/rotavg.hpp>
#include <rotavg/solve/monitor.hpp>

#include "support/contaminated.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::contaminated;
using rotavg::test::Random;

TEST_CASE("reweighting never lets the robust objective rise, with any inner solver") {
  Random random;
  INFO(random.replay());
  const auto [graph, truth, is_wrong] =
      contaminated(random, test::random_connected(random, 60, 300), 0.05, 0.3);
  for (const Method method : {Method::bcd, Method::sum, Method::newton, Method::automatic}) {
    for (const Loss kind :
         {Loss::huber, Loss::l1, Loss::l_half, Loss::cauchy, Loss::geman_mcclure, Loss::tls}) {
      CAPTURE(static_cast<int>(method));
      CAPTURE(static_cast<int>(kind));
      IterationOptions options;
      options.max_iterations = 30;
      const IterationResult result = irls(graph, random.rotations(60), {kind, 0.1}, {},
                                          inner_steps(graph, method, 1), 0.0, options);
      REQUIRE(result.trace.size() > 2);
      for (std::size_t k = 1; k < result.trace.size(); ++k) {
        const double before = result.trace[k - 1].objective;
        CHECK(result.trace[k].objective <= before * (1.0 + 1e-12));
      }
      CHECK(result.objective < result.trace.front().objective);
    }
  }
}

TEST_CASE("a reweighted sweep sets the weights anew before every node") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph(
      test::simulate(random, test::random_connected(random, 25, 60), 0.4));  // of all degrees
  for (const Loss kind :
       {Loss::huber, Loss::l1, Loss::l_half, Loss::cauchy, Loss::geman_mcclure, Loss::tls}) {
    CAPTURE(static_cast<int>(kind));
    const RobustLoss loss{kind, 0.3};
    const Rotations start = random.rotations(25);
    const Monitor monitor(graph, start, {});
    Quaternions q = to_quaternions(start), expected = q;
    const std::vector<double> ones;
    RobustResiduals residuals(graph, ones, 1), newest(graph, ones, 1);
    residuals.update(q, loss);
    reweighted_sweep(residuals, q, monitor);
    MeasurementGraph weighted = graph;
    for (Index l = 0; l < 25; ++l) {
      newest.update(expected, loss);
      weighted.set_weights(newest.weights());
      expected[l] = loso(davenport_matrix(weighted, expected, l), expected[l]);
    }
    for (Index l = 0; l < 25; ++l) CHECK(chordal_distance(q[l], expected[l]) < 1e-9);
  }
}

TEST_CASE("where sweeps have no end and the Laplacian is costly, it is factored now and then") {
  Random random;
  INFO(random.replay());
  constexpr Index half = 300, n = 2 * half;
  test::Pairs pairs = {{0, half}, {1, half + 1}};  // by which sweeps turn a half but slowly
  for (const Index begin : {0, half}) {
    for (const auto& [i, j] : test::random_connected(random, half, 20 * half)) {
      pairs.emplace_back(begin + i, begin + j);
    }
  }
  const auto [graph, truth, is_wrong] = contaminated(random, pairs, 0.05, 0.0);
  Rotations start = truth;
  const Matrix3 turn = exp_so3({0.0, 0.0, 0.4});
  for (Index i = half; i < n; ++i) start[i] = turn * start[i];
  for (const Loss kind : {Loss::huber, Loss::cauchy, Loss::l1}) {
    CAPTURE(static_cast<int>(kind));
    IterationOptions options;
    options.max_iterations = 300;
    const auto by = [&](Method method) {
      return irls(graph, start, {kind, 0.1}, {}, inner_steps(graph, method, 1), 0.0, options);
    };
    const IterationResult sweeps = by(Method::bcd), seldom = by(Method::automatic);
    // The same where a factor is larger than it may be: in the metric of the degrees.
    const IterationResult never = irls(graph, start, {kind, 0.1}, {},
                                       SeldomFactored(1.0, 1, /*max_flops=*/1e4), 0.0, options);
    for (const IterationResult* result : {&seldom, &never}) {
      REQUIRE(is_converged(result->status));
      CHECK(result->iterations > 12);
      CHECK(result->iterations < sweeps.iterations);
      CHECK(result->objective <= sweeps.objective * (1.0 + 1e-9));
      for (std::size_t k = 1; k < result->trace.size(); ++k) {
        CHECK(result->trace[k].objective <= result->trace[k - 1].objective * (1.0 + 1e-12));
      }
    }
  }
}

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/node_rows.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/rigs.hpp>
#include <rotavg/rotavg.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Measurements and priors by their definition.
double definition(const MeasurementGraph& graph, const Priors& priors, const Rotations& R) {
  const NodeRows rows(graph.nodes());
  double f = objective(graph, R);
  for (const AbsolutePrior& p : priors.absolute) {
    f += p.weight * (R[rows.find(p.node)] - p.world_from_node).squaredNorm();
  }
  for (const GravityPrior& p : priors.gravity) {
    const Vector3 d = p.down.normalized(), g = priors.down.normalized();
    f += 2.0 * p.weight * (R[rows.find(p.node)] * d - g).squaredNorm();
  }
  return f;
}

/// Random priors of all kinds, in the world of `truth`.
Priors random_priors(Random& random, const Rotations& truth, double noise) {
  Priors priors;
  priors.down = random.power_of_ten(-1, 1) * random.direction();
  for (Index i = 0; i < static_cast<Index>(truth.size()); ++i) {
    const Matrix3 error = exp_so3(noise * random.normal_vector());
    const double w = random.power_of_ten(-1, 1);
    const Index kind = random.below(6);
    if (kind == 0) priors.fixed.push_back({i, truth[i]});
    if (kind == 1) priors.absolute.push_back({i, error * truth[i], w});
    if (kind >= 2 && kind <= 4) {
      priors.gravity.push_back({i, truth[i].transpose() * error * priors.down, w});
    }
  }
  return priors;
}

}  // namespace

TEST_CASE("with priors of all kinds the optimum is proved, and no rotations nearby are better") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 40; ++k) {
    CAPTURE(k);
    const Index n = 4 + random.below(12);
    const Rotations truth = random.rotations(n);
    auto measurements = test::measure(random, test::random_connected(random, n, 2 * n), truth, 0.1);
    test::spread_weights(random, 0.5, measurements);
    std::vector<NodeId> nodes;
    for (Index i = 0; i < n; ++i) nodes.push_back(i);
    const MeasurementGraph graph(measurements, nodes);
    const Priors priors = random_priors(random, truth, 0.05);
    if (!priors.hold_world() || priors.fixed.size() == truth.size()) continue;
    SolveOptions options;
    options.iteration.tolerance = 1e-12;
    const Solution solution = solve(graph, priors, options);
    CHECK(is_converged(solution.status));
    CHECK(solution.certificate.verdict == Verdict::proved);
    const double f = definition(graph, priors, solution.rotations);
    CHECK(solution.objective == doctest::Approx(f).epsilon(1e-9));
    for (const FixedRotation& p : priors.fixed) {
      CHECK((solution.rotations[p.node] - p.world_from_node).norm() < 1e-14);
    }
    std::vector<bool> free(truth.size(), true);
    for (const FixedRotation& p : priors.fixed) free[p.node] = false;
    for (const double size : {1e-4, 1e-2, 1.0}) {
      for (int turn = 0; turn < 20; ++turn) {
        Rotations moved = test::perturbed(random, solution.rotations, size);
        for (Index i = 0; i < n; ++i) {
          if (!free[i]) moved[i] = solution.rotations[i];
        }
        CHECK(definition(graph, priors, moved) >= f * (1.0 - 1e-12));
      }
    }
    // The bound holds anywhere.
    const GroundedGraph problem(graph, priors);
    Rotations elsewhere = test::perturbed(random, solution.rotations, 0.1);
    for (Index i = 0; i < n; ++i) {
      if (!free[i]) elsewhere[i] = solution.rotations[i];
    }
    const Certificate far = certify(problem, elsewhere);
    CHECK(definition(graph, priors, elsewhere) - f <= far.gap * (1.0 + 1e-9));
    CHECK(certify(problem, solution.rotations).verdict == Verdict::proved);
  }
}

TEST_CASE("cameras of a rig keep their rotations in it, and its optimum is proved") {
  Random random;
  INFO(random.replay());
  constexpr Index frames = 8, cameras = 3, n = frames * cameras;
  for (int k = 0; k < 10; ++k) {
    CAPTURE(k);
    const Rotations rig = random.rotations(cameras), world_from_frame = random.rotations(frames);
    Rotations truth;
    Priors priors;
    for (Index i = 0; i < n; ++i) {
      truth.push_back(world_from_frame[i / cameras] * rig[i % cameras]);
      priors.rigs.push_back({i, 100 + i / cameras, rig[i % cameras]});
    }
    auto measurements = test::measure(random, test::random_connected(random, n, 2 * n), truth, 0.1);
    const MeasurementGraph graph(measurements);
    const bool with_world = k % 2 == 0;
    if (with_world) {
      priors.gravity.push_back({4, truth[4].transpose() * priors.down, 2.0});
      priors.absolute.push_back({9, truth[9], 0.5});
    }
    const Solution solution = solve(graph, priors);
    CHECK(solution.certificate.verdict == Verdict::proved);
    const double f = definition(graph, priors, solution.rotations);
    CHECK(solution.objective == doctest::Approx(f).epsilon(1e-10));
    for (Index i = 0; i < n; ++i) {
      const Matrix3 frame = solution.rotations[i - i % cameras] * rig[0].transpose();
      CHECK((solution.rotations[i] - frame * rig[i % cameras]).norm() < 1e-13);
    }
    // Its bound is that of a problem with fewer unknowns: separate cameras fit no worse.
    Priors separate = priors;
    separate.rigs.clear();
    CHECK(solve(graph, separate).objective <= f * (1.0 + 1e-9));
    for (int turn = 0; turn < 20; ++turn) {
      const Rotations Q =
          test::perturbed(random,
                          ride_on_frames(n, GroundedGraph(graph, priors).priors().rigs)
                              .variables_from(solution.rotations),
                          0.01);
      Rotations moved;
      for (Index i = 0; i < n; ++i) moved.push_back(Q[i / cameras] * rig[i % cameras]);
      CHECK(definition(graph, priors, moved) >= f * (1.0 - 1e-12));
    }
  }
}

TEST_CASE("a rig joins what no edge joins") {
  Random random;
  INFO(random.replay());
  const Rotations rig = random.rotations(2), frames = random.rotations(5);
  std::vector<RelativeRotation> measurements;
  Rotations truth;
  Priors priors;
  for (Index f = 0; f < 5; ++f) {
    for (Index s = 0; s < 2; ++s) {
      truth.push_back(frames[f] * rig[s]);
      priors.rigs.push_back({2 * f + s, f, rig[s]});
    }
  }
  // Front cameras see frames 0, 1, 2; rear ones 2, 3, 4.
  for (const auto& [i, j] : {std::pair{0, 2}, {2, 4}, {5, 7}, {7, 9}, {5, 9}}) {
    measurements.push_back({i, j, truth[i].transpose() * truth[j], 1.0});
  }
  std::vector<NodeId> nodes;
  for (NodeId i = 0; i < 10; ++i) nodes.push_back(i);
  const MeasurementGraph graph(measurements, nodes);
  const Solution solution = solve(graph, priors);
  CHECK(solution.components.size() == 1);
  const Matrix3 gauge = truth[0] * solution.rotations[0].transpose();
  for (Index i = 0; i < 10; ++i) CHECK((gauge * solution.rotations[i] - truth[i]).norm() < 1e-12);
  const RobustSolution robust = solve_robust(graph, priors);
  for (Index i = 0; i < 10; ++i) CHECK((gauge * robust.rotations[i] - truth[i]).norm() < 1e-9);
  CHECK(robust.edge_weights.size() == 5);
}

TEST_CASE("a callback is told the objective without gravity's constant, and may stop") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(12);
  const auto pairs = test::random_connected(random, 12, 24);
  const MeasurementGraph graph(test::measure(random, pairs, truth, 0.1));
  Priors priors;
  for (NodeId i = 0; i < 12; ++i) {
    priors.gravity.push_back({i, truth[i].transpose() * priors.down, 100.0});
  }
  double last = 0.0;
  SolveOptions options;
  options.iteration.callback = [&](const Progress& progress) {
    last = progress.objective;
    return true;
  };
  const Solution solution = solve(graph, priors, options);
  CHECK(last == doctest::Approx(solution.objective).epsilon(1e-9));
  CHECK(solution.trace.back().objective == doctest::Approx(solution.objective).epsilon(1e-12));
  options.iteration.callback = [](const Progress&) { return false; };
  CHECK(solve(graph, priors, options).status == Status::stopped);
}

TEST_CASE("rotations that priors do not allow are not certified but refused") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(4), 0.1);
  Priors priors;
  priors.fixed = {{2, random.rotation()}};
  const GroundedGraph problem(graph, priors);
  Rotations R = solve(problem).rotations;
  R[2] = exp_so3({1e-3, 0.0, 0.0}) * R[2];
  CHECK_THROWS_AS(certify(problem, R), InvalidRotation);
}

TEST_CASE("iterations and seconds go on counting from stage to stage, and limits hold for all") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 30;
  const Rotations truth = random.rotations(n);
  const MeasurementGraph graph(
      test::measure(random, test::random_connected(random, n, 2 * n), truth, 0.1));
  Priors priors;
  for (Index i = 0; i < n; ++i) {
    const Matrix3 error = exp_so3(0.1 * random.normal_vector());
    priors.absolute.push_back({i, i < 8 ? random.rotation() : Matrix3(error * truth[i]), 1.0});
  }
  for (const bool robust : {false, true}) {
    CAPTURE(robust);
    std::vector<Progress> told;
    SolveOptions options;
    options.iteration.callback = [&](const Progress& progress) {
      told.push_back(progress);
      return true;
    };
    const auto run = [&] {
      return robust ? Solution(solve_robust(graph, priors, options))
                    : solve(graph, priors, options);
    };
    const Solution solution = run();
    CHECK(is_converged(solution.status));
    CHECK(told.front().iteration <= 1);
    CHECK(told.back().iteration == solution.iterations);
    for (std::size_t k = 1; k < told.size(); ++k) {
      CHECK(told[k].iteration > told[k - 1].iteration);
      CHECK(told[k].seconds >= told[k - 1].seconds);
    }
    options.iteration.callback = nullptr;
    for (const int most : {1, solution.iterations / 2, solution.iterations - 1}) {
      CAPTURE(most);
      options.iteration.max_iterations = most;
      CHECK(run().iterations <= most);
    }
  }
}

TEST_CASE("a warm start of parts that a rig joins is turned as one") {
  Random random;
  INFO(random.replay());
  const Rotations rig = random.rotations(2), frames = random.rotations(6);
  Rotations truth;
  Priors priors;
  for (Index f = 0; f < 6; ++f) {
    for (Index s = 0; s < 2; ++s) {
      truth.push_back(frames[f] * rig[s]);
      priors.rigs.push_back({2 * f + s, f, rig[s]});
    }
  }
  // Front cameras see each other, and rear ones: no edge joins the two kinds.
  const test::Pairs pairs = {{0, 2}, {2, 4}, {4, 6}, {0, 6}, {5, 7}, {7, 9}, {9, 11}, {5, 11}};
  std::vector<NodeId> nodes;
  for (NodeId i = 0; i < 12; ++i) nodes.push_back(i);
  const MeasurementGraph graph(test::measure(random, pairs, truth, 0.01), nodes);
  // Two priors that contradict each other turn a torn start to two worlds.
  priors.absolute = {{0, truth[0], 1e-3}, {11, random.rotation() * truth[11], 1e-3}};
  const GroundedGraph problem(graph, priors);
  CHECK(components_without_world(problem).size() == 1);
  CHECK(connected_components(graph).size() > 1);
  const Solution solution = solve(problem);
  SolveOptions none;
  none.iteration.max_iterations = 0;
  none.certify = false;
  const Solution again = solve(problem, none, solution.rotations, true);
  double moved = 0.0;
  for (Index i = 1; i < 12; ++i) {
    moved = std::max(moved, angle_between(solution.rotations[0].transpose() * solution.rotations[i],
                                          again.rotations[0].transpose() * again.rotations[i]));
  }
  CHECK(moved < 1e-12);
}

TEST_CASE("the gap told is that of the rotations given, not of those next to them") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(6);
  const MeasurementGraph graph(test::measure(random, test::complete(6), truth, 0.0));
  Priors priors;
  priors.fixed = {{2, truth[2]}};
  priors.rigs = {{0, 0, truth[0]}, {1, 0, truth[1]}};
  const GroundedGraph problem(graph, priors);
  const Rotations best = solve(problem).rotations;
  CHECK(certify(problem, best).verdict == Verdict::proved);
  for (const Index off : {0, 2}) {
    CAPTURE(off);
    Rotations R = best;
    R[off] = exp_so3(9e-7 * random.direction()) * R[off];
    const Certificate certificate = certify(problem, R);
    const double f = objective(graph, R);
    CHECK(f > 1e-13);
    CHECK(f <= certificate.gap * (1.0 + 1e-6));
    CHECK(certificate.relative_gap > 0.1);
    CHECK(certificate.verdict == Verdict::not_certified);
    CHECK(certificate.shortfall != Shortfall::none);
  }
}

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

TEST_CASE("robust losses take no notice of outliers where there are priors and rigs, too") {
  Random random;
  INFO(random.replay());
  constexpr Index frames = 25, n = 2 * frames;
  const Rotations rig = random.rotations(2), Q = random.rotations(frames);
  Rotations truth;
  Priors priors;
  for (Index i = 0; i < n; ++i) {
    truth.push_back(Q[i / 2] * rig[i % 2]);
    priors.rigs.push_back({i, i / 2, rig[i % 2]});
  }
  const test::Pairs pairs = test::random_connected(random, n, 8 * n);
  auto measurements = test::measure(random, pairs, truth, 0.01);
  std::vector<bool> wrong;
  for (RelativeRotation& m : measurements) {
    wrong.push_back(random.below(5) == 0);
    if (wrong.back()) m.i_from_j = random.rotation();
  }
  priors.fixed = {{3, truth[3]}};
  const MeasurementGraph graph(measurements);
  const RobustSolution solution = solve_robust(graph, priors);
  double largest = 0.0;
  for (Index i = 0; i < n; ++i) {
    largest = std::max(largest, angle_between(solution.rotations[i], truth[i]));
  }
  CHECK(largest < 0.02);
  for (std::size_t k = 0; k < wrong.size(); ++k) {
    const Edge& e = graph.edges()[k];
    if (angle_between(truth[e.i] * e.i_from_j(), truth[e.j]) > 0.2) {
      CHECK(is_outlier(solution.verdicts.edges[k]));
      CHECK(solution.edge_weights[k] < 0.05);
    }
  }
  CHECK((solution.rotations[3] - truth[3]).norm() < 1e-14);
}

TEST_CASE("marginal covariances with priors are those of heavy absolute priors in the limit") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      test::simulate_graph(random, test::random_connected(random, 10, 20), 0.05);
  const Rotations R = solve(graph).rotations;
  Priors held, heavy;
  for (const NodeId node : {2, 5}) {
    held.fixed.push_back({node, R[node]});
    heavy.absolute.push_back({node, R[node], 1e7});
  }
  for (Priors* priors : {&held, &heavy}) {
    priors->gravity.push_back({8, R[8].transpose() * priors->down, 3.0});
  }
  const GroundedGraph a(graph, held), b(graph, heavy);
  const auto A = marginal_covariances(a, solve(a).rotations);
  const auto B = marginal_covariances(b, solve(b).rotations);
  REQUIRE(A.status == CovarianceStatus::computed);
  REQUIRE(B.status == CovarianceStatus::computed);
  for (Index i = 0; i < 10; ++i) CHECK((A.pairs[i] - B.pairs[i]).norm() < 1e-5);
  CHECK(A.pairs[2].norm() == 0.0);
  const auto pair = covariances(a, solve(a).rotations, {{2, 7}});
  CHECK((pair.pairs[0] - A.pairs[7]).norm() < 1e-12);
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

TEST_CASE("covariances with priors take no free turns but gravity's, and no other rows") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      test::simulate_graph(random, test::random_connected(random, 6, 8), 0.05);
  Priors priors;
  priors.gravity = {{1, Vector3::UnitX(), 2.0}};
  const GroundedGraph problem(graph, priors);
  const Rotations R = solve(problem).rotations;
  CovarianceOptions options;
  const auto expected = covariances(problem, R, {{0, 3}}, options);
  options.free_turns = {{2, Vector3::UnitZ()}};
  options.turn_of.assign(7, 0);
  const auto found = covariances(problem, R, {{0, 3}}, options);
  REQUIRE(found.status == CovarianceStatus::computed);
  CHECK(found.pairs[0] == expected.pairs[0]);
  CHECK_THROWS_AS(covariances(problem, R, {{0, 6}}), std::invalid_argument);
  CHECK_THROWS_AS(covariances(problem, R, {{-1, 2}}), std::invalid_argument);
  // Precisions of edges and priors that are those of weights: nearly the same covariances.
  for (const Edge& e : graph.edges()) options.information.push_back(multiple_of_identity(e.weight));
  const auto precise = covariances(problem, R, {{0, 3}}, options);
  REQUIRE(precise.status == CovarianceStatus::computed);
  CHECK((precise.pairs[0] - found.pairs[0]).norm() < 0.1 * found.pairs[0].norm());
}

TEST_CASE("parts that the world holds are joined, but not by gravity") {
  Random random;
  INFO(random.replay());
  constexpr Index half = 15, n = 2 * half;
  const Rotations truth = random.rotations(n);
  test::Pairs pairs = test::random_connected(random, half, 3 * half);
  for (const auto& [i, j] : test::random_connected(random, half, 3 * half)) {
    pairs.emplace_back(i + half, j + half);
  }
  auto measurements = test::measure(random, pairs, truth, 0.01);
  measurements.push_back({0, half, random.rotation(), 1.0});  // two wrong ones join the halves
  measurements.push_back({1, half + 1, random.rotation(), 1.0});
  const MeasurementGraph graph(measurements);
  RobustOptions robust;
  robust.known.excluded.assign(measurements.size(), false);
  *(robust.known.excluded.end() - 1) = *(robust.known.excluded.end() - 2) = true;
  const auto parts = [&](const Priors& priors) {
    const RobustSolution solution = solve_robust(graph, priors, {}, robust);
    return *std::max_element(solution.verdicts.part.begin(), solution.verdicts.part.end()) + 1;
  };
  Priors fixed, tilted;
  fixed.fixed = {{3, truth[3]}, {half + 3, truth[half + 3]}};
  CHECK(parts(fixed) == 1);
  for (const EdgeVerdict verdict : solve_robust(graph, fixed).verdicts.edges) {
    CHECK(verdict != EdgeVerdict::weak_part);
  }
  for (Index i = 0; i < n; ++i) {
    tilted.gravity.push_back({i, truth[i].transpose() * tilted.down, 1.0});
  }
  CHECK(parts(tilted) == 2);
  Priors one;
  for (Index i = 0; i < half; ++i) one.absolute.push_back({i, truth[i], 1.0});
  CHECK(parts(one) == 2);
  one.absolute.push_back({half + 3, truth[half + 3], 1.0});
  CHECK(parts(one) == 1);
}

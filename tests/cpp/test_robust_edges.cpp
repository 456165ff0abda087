// What a robust loss makes of the edges by themselves: what cycles check, what weights say, what is
// known beforehand.

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/checked_part.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/reduction/refined_gravity.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/solve_robust_with_priors.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

double turn(const Rotations& R, const Rotations& truth) {
  double error = 0.0;
  for (std::size_t i = 0; i < R.size(); ++i) {
    error =
        std::max(error, angle_between(truth[0].transpose() * truth[i], R[0].transpose() * R[i]));
  }
  return error;
}

double value(const MeasurementGraph& graph, const Rotations& R, const RobustLoss& loss) {
  std::vector<double> x;
  squared_residuals(ResidualQuaternions(graph, to_quaternions(R), 1), x);
  return robust_objective(graph.weights(), x, loss, {}, 1);
}

constexpr Loss all_losses[] = {Loss::automatic, Loss::huber,         Loss::l1,
                               Loss::l_half,    Loss::geman_mcclure, Loss::tls};

}  // namespace

TEST_CASE("series are edges that no cycle separates; bridges are in none") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 40; ++repeat) {
    const Index n = 2 + random.below(10);
    const auto measurements =
        test::simulate(random, test::random_connected(random, n, random.below(n)), 0.0);
    const MeasurementGraph graph(measurements);
    const Series series = series_of(graph);
    const std::vector<bool> is_bridge = bridges(graph);
    const auto parts = [&](std::vector<bool> holds) {
      const auto part = parts_joined_by(graph, holds);
      return *std::max_element(part.begin(), part.end()) + 1;
    };
    CHECK(series.num_cycles == graph.num_edges() - n + 1);
    for (Index k = 0; k < graph.num_edges(); ++k) {
      CHECK((series.label[k] < 0) == is_bridge[k]);
      // Two edges are in series if the graph without both falls apart, and without one does not.
      for (Index l = 0; l < k; ++l) {
        if (is_bridge[k] || is_bridge[l]) continue;
        std::vector<bool> holds(graph.edges().size(), true);
        holds[k] = holds[l] = false;
        CHECK((series.label[k] == series.label[l]) == (parts(holds) == 2));
      }
    }
    // What is left out is as if it were not there.
    std::vector<bool> left_out(graph.edges().size(), false);
    left_out[random.below(graph.num_edges())] = true;
    std::vector<bool> holds(left_out.size());
    for (std::size_t k = 0; k < holds.size(); ++k) holds[k] = !left_out[k];
    const Series rest = series_of(graph, left_out);
    CHECK(rest.num_cycles == graph.num_edges() - 1 - n + parts(holds));
  }
}

TEST_CASE("the part that cycles check is the graph without its bridges, which are met exactly") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 20; ++repeat) {
    const Index n = 3 + random.below(12);
    const MeasurementGraph graph(test::simulate(random, test::random_connected(random, n, 2), 0.3));
    const CheckedPart part(graph, {});
    Rotations R = random.rotations(part.graph().num_nodes());
    const Rotations all = part.extended(R);
    REQUIRE(all.size() == static_cast<std::size_t>(n));
    std::vector<double> x, x_part;
    squared_residuals(ResidualQuaternions(graph, to_quaternions(all), 1), x);
    squared_residuals(ResidualQuaternions(part.graph(), to_quaternions(R), 1), x_part);
    const std::vector<double> kept = part.of_edges(x);
    REQUIRE(kept.size() == x_part.size());
    for (std::size_t k = 0; k < kept.size(); ++k) {
      CHECK(kept[k] == doctest::Approx(x_part[k]).epsilon(1e-9).scale(1.0));
    }
    for (Index k = 0; k < graph.num_edges(); ++k) {
      if (part.is_bridge(k)) CHECK(x[k] < 1e-20);
    }
  }
}

TEST_CASE("a chain of bridges changes nothing of what it hangs on, with any loss") {
  Random random;
  INFO(random.replay());
  const auto core = test::simulate(random, test::complete(5), 0.03);
  auto chain = core;
  for (Index i = 4; i < 9; ++i) chain.push_back({i, i + 1, random.rotation(), 1.0});
  const MeasurementGraph with(chain), without(core);
  for (const Loss kind : all_losses) {
    CAPTURE(static_cast<int>(kind));
    RobustOptions robust;
    robust.loss = kind;
    const RobustSolution a = solve_robust(without, {}, robust), b = solve_robust(with, {}, robust);
    CHECK(a.noise == b.noise);
    CHECK(a.loss.scale == b.loss.scale);
    for (std::size_t k = 0; k < chain.size(); ++k) {
      const EdgeVerdict expected = k < core.size() ? a.verdicts.edges[k] : EdgeVerdict::bridge;
      CHECK(b.verdicts.edges[k] == expected);
    }
    CHECK(b.certificate.verdict == Verdict::proved);
  }
}

TEST_CASE("of a ring, what it leaves over is one datum, however it is shared") {
  std::vector<RelativeRotation> ring;
  for (Index i = 0; i < 9; ++i) ring.push_back({i, (i + 1) % 9, exp_so3({0, 0, 0.7155}), 1.0});
  const MeasurementGraph graph(ring);
  const double left = std::abs(9 * 0.7155 - 2.0 * 3.141592653589793);
  const Series series = series_of(graph);
  CHECK(series.size == 1);
  CHECK(series.freedom() == 1.0);
  std::vector<double> even(9, left * left / 81.0), one(9, 0.0);
  one[4] = left * left;
  CHECK(series_residuals(series, even, {})[0] == doctest::Approx(left * left / 9.0));
  CHECK(series_residuals(series, one, {})[0] == doctest::Approx(left * left / 9.0));
  for (const Loss kind : all_losses) {
    RobustOptions robust;
    robust.loss = kind;
    const RobustSolution solution = solve_robust(graph, {}, robust);
    CHECK(solution.noise == doctest::Approx(left / 3.0 / 0.6724).epsilon(0.02));
    for (const EdgeVerdict verdict : solution.verdicts.edges) CHECK(!is_outlier(verdict));
  }
}

TEST_CASE("a wrong edge in a chain between junctions is found, and one edge of the chain named") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::complete(12);
  const auto first = static_cast<std::size_t>(pairs.size());
  for (Index i = 0; i < 4; ++i) pairs.emplace_back(i == 0 ? 0 : 11 + i, i == 3 ? 5 : 12 + i);
  auto measurements = test::measure(random, pairs, random.rotations(15), 0.01);
  measurements[first + 2].i_from_j *= exp_so3(0.5 * random.direction());
  const RobustSolution solution = solve_robust(MeasurementGraph(measurements));
  Index named = 0;
  for (std::size_t k = first; k < pairs.size(); ++k) {
    named += is_outlier(solution.verdicts.edges[k]);
  }
  CHECK(named >= 1);
  CHECK(named < 4);
}

TEST_CASE("where weights are inverse variances, residuals are judged in their units") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(40);
  const test::Pairs pairs = test::random_connected(random, 40, 260);
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : pairs) {
    const double sigma = random.below(2) == 0 ? 0.005 : 0.05;
    const Matrix3 exact = truth[i].transpose() * truth[j];
    const Vector3 noise(random.normal(), random.normal(), random.normal());
    measurements.push_back({i, j, exact * exp_so3(sigma * noise), 1.0 / (sigma * sigma)});
  }
  // One in ten is wrong, and said to be the most precise of all.
  std::vector<bool> is_wrong(measurements.size(), false);
  for (std::size_t k = 0; k < measurements.size(); k += 10) {
    is_wrong[k] = true;
    measurements[k].i_from_j = random.rotation();
    measurements[k].weight = 1e6;
  }
  const MeasurementGraph graph(measurements);
  RobustOptions robust;
  for (const WeightKind kind : {WeightKind::automatic, WeightKind::precision}) {
    robust.weight_kind = kind;
    const RobustSolution solution = solve_robust(graph, {}, robust);
    CHECK(turn(solution.rotations, truth) < 0.02);
    Index missed = 0, accused = 0;
    for (std::size_t k = 0; k < is_wrong.size(); ++k) {
      missed += is_wrong[k] && !is_outlier(solution.verdicts.edges[k]);
      accused += !is_wrong[k] && is_outlier(solution.verdicts.edges[k]);
    }
    CHECK(missed == 0);
    CHECK(accused <= 25);  // of 270; 130 have ten times the noise of the others
  }
  // Multiplied by a common factor, weights say the same.
  for (RelativeRotation& m : measurements) m.weight *= 64.0;
  const RobustSolution one = solve_robust(graph),
                       other = solve_robust(MeasurementGraph(measurements));
  CHECK(one.noise == doctest::Approx(other.noise).epsilon(1e-9));
  CHECK(one.verdicts.edges == other.verdicts.edges);
}

TEST_CASE("scales of the edges, trusted and excluded edges, and initial weights are heeded") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(20);
  auto measurements = test::measure(random, test::complete(20), truth, 0.01);
  for (std::size_t k = 0; k < 3; ++k) measurements[k].i_from_j *= exp_so3({0.0, 0.2, 0.0});
  const MeasurementGraph graph(measurements);
  const std::size_t m = measurements.size();
  const RobustSolution plain = solve_robust(graph);
  for (std::size_t k = 0; k < 3; ++k) CHECK(is_outlier(plain.verdicts.edges[k]));

  RobustOptions robust;
  robust.known.trusted.assign(m, false);
  robust.known.trusted[0] = true;
  robust.known.excluded.assign(m, false);
  robust.known.excluded[1] = robust.known.excluded[5] = true;
  robust.known.scales.assign(m, 1.0);
  robust.known.scales[2] = 100.0;
  const RobustSolution solution = solve_robust(graph, {}, robust);
  CHECK(solution.verdicts.edges[0] == EdgeVerdict::trusted);
  CHECK(solution.edge_weights[0] == 1.0);
  CHECK(std::isinf(solution.edge_scales[0]));
  for (const std::size_t k : {1, 5}) {
    CHECK(solution.verdicts.edges[k] == EdgeVerdict::excluded);
    CHECK(solution.edge_weights[k] <= 1.01e-6);
  }
  CHECK(solution.verdicts.edges[2] == EdgeVerdict::inlier);
  CHECK(solution.edge_weights[2] > 0.9);
  CHECK(solution.edge_scales[2] == doctest::Approx(100.0));

  // The first least squares with these weights meet what they keep, and leave the graph as it was.
  auto torn = test::measure(random, test::complete(12), random.rotations(12), 0.0);
  std::vector<double> kept;
  for (RelativeRotation& measurement : torn) {
    const bool bad = measurement.i == 0 && measurement.j > 4;
    if (bad) measurement.i_from_j = exp_so3({0.0, 0.0, 1.0}) * measurement.i_from_j;
    kept.push_back(bad ? 0.0 : 1.0);
  }
  const MeasurementGraph misled(torn);
  RobustRun run(misled, {}, series_of(misled), {}, Stopwatch());
  Initialization init = Initialization::automatic;
  const auto left = [&](const Rotations& R) {
    double largest = 0.0;
    for (std::size_t k = 0; k < torn.size(); ++k) {
      if (kept[k] > 0.0) largest = std::max(largest, residual(misled.edges()[k], R).norm());
    }
    return largest;
  };
  CHECK(left(run.least_squares(kept, init)) < 1e-2);
  CHECK(left(run.least_squares({}, init)) > 0.1);

  const auto refuses = [&](const EdgeKnowledge& bad) {
    RobustOptions options;
    options.known = bad;
    CHECK_THROWS_AS(solve_robust(graph, {}, options), std::invalid_argument);
  };
  refuses({{true}, {}, {}, {}});
  refuses({std::vector<bool>(m, true), std::vector<bool>(m, true), {}, {}});
  refuses({{}, {}, std::vector<double>(m, 0.0), {}});
  refuses({{}, {}, {}, std::vector<double>(m, 1.5)});
}

TEST_CASE("no loss ends above an objective that a start had") {
  constexpr double rounding = 1e-12;
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 40; ++repeat) {
    const Rotations truth = random.rotations(5);
    auto measurements = test::measure(random, test::complete(5), truth, 0.0);
    const Index a = random.below(10), b = (a + 1 + random.below(9)) % 10;
    for (const Index k : {a, b}) measurements[k].i_from_j = random.rotation();
    const MeasurementGraph graph(measurements);
    for (const Loss kind : {Loss::automatic, Loss::geman_mcclure, Loss::tls}) {
      CAPTURE(static_cast<int>(kind));
      RobustOptions robust;
      robust.loss = kind;
      const RobustSolution solution = solve_robust(graph, {}, robust);
      const double reached = value(graph, solution.rotations, solution.loss);
      for (const Rotations& start : {truth, solve(graph).rotations, spanning_tree_init(graph)}) {
        CHECK(reached <= value(graph, start, solution.loss) * (1.0 + rounding));
      }
      CHECK(solution.certificate.verdict == Verdict::proved);
      CHECK(turn(solution.rotations, truth) < 1e-3);
      const RobustSolution from = solve_robust(graph, {}, robust, truth);
      CHECK(value(graph, from.rotations, from.loss) <=
            value(graph, truth, from.loss) * (1.0 + rounding));
    }
  }
}

TEST_CASE("every legal small graph is solved with every loss, whatever is known of its edges") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 200; ++repeat) {
    // Parts of any size, parallel edges, nodes without edges, edges of any quality and weight.
    const Index n = 2 + random.below(8), m = 1 + random.below(20);
    const double noise = std::pow(10.0, random.uniform(-9.0, 0.0));
    const double spread = random.uniform(0.0, 6.0), wrong = random.uniform(0.0, 1.0);
    const Rotations truth = random.rotations(n);
    std::vector<RelativeRotation> measurements;
    std::vector<NodeId> nodes;
    for (Index i = 0; i < n; ++i) nodes.push_back(i);
    RobustOptions robust;
    for (Index k = 0; k < m; ++k) {
      const Index i = random.below(n), j = (i + 1 + random.below(n - 1)) % n;
      const Matrix3 right =
          truth[i].transpose() * truth[j] * exp_so3(noise * random.normal_vector());
      measurements.push_back({i, j, random.uniform(0.0, 1.0) < wrong ? random.rotation() : right,
                              std::exp(spread * random.normal())});
      const double role = random.uniform(0.0, 1.0);
      robust.known.trusted.push_back(role < 0.1);
      robust.known.excluded.push_back(role > 0.9);
    }
    if (random.below(2) == 0) robust.known = {};
    if (random.below(3) == 0) robust.cycle_threshold = 0.1;
    robust.weight_kind = random.below(2) == 0 ? WeightKind::precision : WeightKind::frequency;
    robust.loss = all_losses[random.below(6)];
    CAPTURE(repeat);
    const RobustSolution solution = solve_robust(MeasurementGraph(measurements, nodes), {}, robust);
    CHECK(solution.rotations.size() == static_cast<std::size_t>(n));
    for (const Matrix3& R : solution.rotations) CHECK(R.allFinite());
    CHECK(std::isfinite(solution.robust_objective));
    CHECK(std::isfinite(solution.noise));
    CHECK(solution.verdicts.edges.size() == static_cast<std::size_t>(m));
    CHECK(solution.verdicts.part.size() == static_cast<std::size_t>(n));
  }
}

TEST_CASE("wrong edges with many more matches than the right ones stay out") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 3; ++repeat) {
    const Rotations truth = random.rotations(40);
    auto measurements = test::measure(random, test::random_connected(random, 40, 280), truth, 0.01);
    std::vector<bool> wrong;
    for (RelativeRotation& m : measurements) {
      wrong.push_back(random.below(5) == 0);
      m.weight = random.uniform(20.0, 200.0);
      if (!wrong.back()) continue;
      m.i_from_j = random.rotation();
      m.weight *= 30.0;
    }
    const RobustSolution solution = solve_robust(MeasurementGraph(measurements));
    CHECK(turn(solution.rotations, truth) < 0.05);
    for (std::size_t k = 0; k < wrong.size(); ++k) {
      if (wrong[k]) CHECK(is_outlier(solution.verdicts.edges[k]));
    }
  }
}

TEST_CASE("ten right edges of fifty between two nodes are enough, without noise and with") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.0, 0.001, 0.03}) {
    for (int repeat = 0; repeat < 10; ++repeat) {
      const Rotations truth = random.rotations(2);
      std::vector<RelativeRotation> measurements;
      for (int k = 0; k < 50; ++k) {
        const Vector3 off(random.normal(), random.normal(), random.normal());
        const Matrix3 right = truth[0].transpose() * truth[1] * exp_so3(noise * off);
        measurements.push_back({0, 1, k < 10 ? right : random.rotation(), 1.0});
      }
      for (const Loss kind : {Loss::automatic, Loss::geman_mcclure, Loss::tls}) {
        CAPTURE(static_cast<int>(kind));
        RobustOptions robust;
        robust.loss = kind;
        const RobustSolution solution = solve_robust(MeasurementGraph(measurements), {}, robust);
        CHECK(turn(solution.rotations, truth) < 3.0 * noise + 1e-4);
      }
    }
  }
}

TEST_CASE("wrong priors do not tilt the world: a loss on gravity and absolute rotations") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(50);
  const MeasurementGraph graph(
      test::measure(random, test::random_connected(random, 50, 150), truth, 0.01));
  Priors priors;
  std::vector<bool> is_wrong;
  for (Index i = 0; i < 50; ++i) {
    is_wrong.push_back(i % 4 == 1);
    const Vector3 off(random.normal(), random.normal(), random.normal());
    const Vector3 down = exp_so3(0.01 * off) * truth[i].transpose() * Vector3::UnitY();
    priors.gravity.push_back({i, is_wrong.back() ? random.direction() : down, 1.0});
    const Matrix3 known = truth[i] * exp_so3(0.02 * random.direction());
    if (i % 3 == 0) {
      priors.absolute.push_back({i, i % 12 == 0 ? random.rotation() : known, 1.0});
    }
  }
  const auto tilt = [&](const Rotations& R) {
    double largest = 0.0;
    for (std::size_t i = 0; i < R.size(); ++i) {
      largest = std::max(
          largest, (R[i] * truth[i].transpose() * Vector3::UnitY() - Vector3::UnitY()).norm());
    }
    return largest;
  };
  RobustOptions robust;
  robust.priors = false;
  CHECK(tilt(solve_robust(graph, priors, {}, robust).rotations) > 0.05);
  for (const Loss kind : {Loss::automatic, Loss::l1, Loss::geman_mcclure, Loss::tls}) {
    CAPTURE(static_cast<int>(kind));
    robust = RobustOptions{};
    robust.loss = kind;
    const RobustSolution solution = solve_robust(graph, priors, {}, robust);
    CHECK(tilt(solution.rotations) < 0.03);
    CHECK(solution.certificate.verdict == Verdict::proved);
    REQUIRE(solution.gravity.is_outlier.size() == 50);
    REQUIRE(solution.absolute.is_outlier.size() == 17);
    Index missed = 0, accused = 0;
    for (Index i = 0; i < 50; ++i) {
      missed += is_wrong[i] && !solution.gravity.is_outlier[i];
      accused += !is_wrong[i] && solution.gravity.is_outlier[i];
      CHECK(solution.gravity.weights[i] <= 1.0 + 1e-12);
    }
    CHECK(missed <= 1);  // random directions can be right
    CHECK(accused <= 4);
    for (std::size_t k = 0; k < 17; ++k) CHECK(solution.absolute.is_outlier[k] == (k % 4 == 0));
    // What is proved is the problem with the final weights.
    GroundedGraph weighted(graph, priors);
    weighted.set_weights(solution.edge_weights);
    weighted.set_prior_weights(solution.absolute.weights, solution.gravity.weights);
    CHECK(objective(weighted, solution.rotations) ==
          doctest::Approx(solution.objective).epsilon(1e-9));
  }
}

TEST_CASE("gravity estimated from the neighbours is nearer the truth, and wrong directions go") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(60);
  const MeasurementGraph graph(
      test::measure(random, test::random_connected(random, 60, 400), truth, 0.005));
  std::vector<Vector3> down, exact;
  for (Index i = 0; i < 60; ++i) {
    exact.push_back(truth[i].transpose() * Vector3::UnitY());
    const Vector3 off(random.normal(), random.normal(), random.normal());
    down.push_back(3.0 * (exp_so3(0.03 * off) * exact.back()));
    if (i % 5 == 2) down.back() = random.direction();
    if (i == 7) down.back().setZero();  // not known
  }
  const std::vector<Vector3> refined = refined_gravity(graph, down);
  for (Index i = 0; i < 60; ++i) {
    CHECK(refined[i].norm() == doctest::Approx(1.0).epsilon(1e-12));
    CHECK((refined[i] - exact[i]).norm() < 0.06);
  }
  CHECK(refined_gravity(graph, std::vector<Vector3>(60, Vector3::Zero()))[3].isZero(0.0));
  CHECK_THROWS_AS(refined_gravity(graph, {}), std::invalid_argument);
}

TEST_CASE(
    "edges inside frames are judged in the units of those between frames, and left out alike") {
  Random random;
  INFO(random.replay());
  constexpr Index frames = 30, n = 2 * frames;
  const Rotations rig = random.rotations(2), Q = random.rotations(frames);
  Rotations truth;
  Priors priors;
  for (Index i = 0; i < n; ++i) {
    truth.push_back(Q[i / 2] * rig[i % 2]);
    priors.rigs.push_back({i, i / 2, rig[i % 2]});
  }
  test::Pairs pairs;
  for (const auto& [i, j] : test::random_connected(random, n, 5 * n)) {
    if (i / 2 != j / 2) pairs.emplace_back(i, j);
  }
  const std::size_t between = pairs.size();
  auto measurements = test::measure(random, pairs, truth, 0.04);
  for (int k = 0; k < 20; ++k) {  // more of them than between frames, ten times as precise
    for (Index f = 0; f < frames; ++f) {
      for (auto m : test::measure(random, {{2 * f, 2 * f + 1}}, truth, 0.004)) {
        m.weight = 100.0;
        measurements.push_back(m);
      }
    }
  }
  const std::size_t wrong = between, out = between + 1, out_between = 0;
  measurements[wrong].i_from_j = exp_so3({0.05, 0.0, 0.0}) * truth[0].transpose() * truth[1];
  std::vector<NodeId> nodes;
  for (NodeId i = 0; i < n; ++i) nodes.push_back(i);
  const MeasurementGraph graph(measurements, nodes);
  RobustOptions robust;
  robust.known.excluded.assign(measurements.size(), false);
  robust.known.excluded[out] = robust.known.excluded[out_between] = true;
  for (const bool with_world : {false, true}) {
    CAPTURE(with_world);
    if (with_world) priors.fixed = {{3, truth[3]}};
    const RobustSolution solution = solve_robust(graph, priors, {}, robust);
    CHECK(solution.noise > 0.02);
    CHECK(solution.noise < 0.06);
    Index outliers = 0;
    for (std::size_t k = 0; k < measurements.size(); ++k) {
      CHECK(solution.edge_scales[k] == doctest::Approx(k < between ? 1.0 : 0.1));
      outliers += is_outlier(solution.verdicts.edges[k]);
    }
    CHECK(outliers < 0.05 * static_cast<double>(measurements.size()));
    CHECK(solution.verdicts.edges[wrong] == EdgeVerdict::robust_weight);
    CHECK(solution.verdicts.edges[out] == EdgeVerdict::excluded);
    CHECK(solution.edge_weights[out] <= 1.001e-6 * graph.edges()[out].weight);
    CHECK(solution.edge_weights[out_between] <= 1.001e-6);
    for (std::size_t k = 0; k < measurements.size(); ++k) {
      CHECK(solution.edge_weights[k] >= 0.999e-12 * graph.edges()[k].weight);
    }
  }
}

// What a robust loss makes of the edges by themselves: what weights say, what is known beforehand.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/series.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/without_outliers.hpp>
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
  squared_residuals(graph, to_quaternions(R), 1, x);
  return robust_objective(graph.weights(), x, loss, {}, 1);
}

constexpr Loss all_losses[] = {Loss::automatic, Loss::huber,         Loss::l1,
                               Loss::l_half,    Loss::geman_mcclure, Loss::tls};

}  // namespace

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
  refuses({{}, {}, {}, {}, {true}});
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

TEST_CASE("weights at the bounds of what is legal are reweighted") {
  Random random;
  INFO(random.replay());
  for (const double weight : {min_weight, max_weight}) {
    MeasurementGraph graph(test::simulate(random, test::complete(6), 0.1));
    graph.set_weights(std::vector<double>(graph.weights().size(), weight));
    const std::vector<double> ones;
    RobustResiduals residuals(graph, ones, 1);
    residuals.update(to_quaternions(random.rotations(6)), {Loss::tls, 3.0});
    CHECK_NOTHROW(graph.set_weights(residuals.weights()));
  }
}

TEST_CASE("the graph without outliers has the others as they were, and all nodes") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(20);
  std::vector<RelativeRotation> measurements;
  std::vector<NodeId> nodes;
  for (Index i = 0; i < 20; ++i) nodes.push_back(100 - 3 * i);
  for (const auto& [i, j] : test::random_connected(random, 20, 90)) {
    measurements.push_back(
        {nodes[i], nodes[j], truth[i].transpose() * truth[j], 1.0 + random.below(5)});
  }
  const MeasurementGraph graph(measurements, nodes);
  EdgeVerdicts verdicts;
  std::vector<RelativeRotation> kept;
  for (const RelativeRotation& m : measurements) {
    verdicts.edges.push_back(static_cast<EdgeVerdict>(random.below(7)));
    if (verdicts.edges.back() < EdgeVerdict::robust_weight) kept.push_back(m);
  }
  REQUIRE(!kept.empty());
  const MeasurementGraph expected(kept, nodes), found = without_outliers(graph, verdicts);
  CHECK(found.nodes() == nodes);
  REQUIRE(found.num_edges() == expected.num_edges());
  for (Index k = 0; k < found.num_edges(); ++k) {
    const QuaternionEdge &a = found.quaternion_edges()[k], &b = expected.quaternion_edges()[k];
    CHECK(a.i == b.i);
    CHECK(a.j == b.j);
    CHECK(found.weights()[k] == expected.weights()[k]);
    CHECK((a.i_from_j.coeffs() - b.i_from_j.coeffs()).norm() < 1e-14);
  }
  CHECK(solve(found).objective < 1e-20);
  verdicts.edges.assign(measurements.size(), EdgeVerdict::excluded);
  CHECK_THROWS_AS(without_outliers(graph, verdicts), std::invalid_argument);
  verdicts.edges.pop_back();
  CHECK_THROWS_AS(without_outliers(graph, verdicts), std::invalid_argument);
}

// A robust loss where rotations, gravity or rigs are known.

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/reduction/refined_gravity.hpp>
#include <rotavg/robust/solve_robust_with_priors.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Rotations of the cameras of frames with two each, in the rig that the priors receive.
Rotations two_cameras_each(Random& random, Index frames, Priors& priors) {
  const Rotations rig = random.rotations(2), Q = random.rotations(frames);
  Rotations truth;
  for (Index i = 0; i < 2 * frames; ++i) {
    truth.push_back(Q[i / 2] * rig[i % 2]);
    priors.rigs.push_back({i, i / 2, rig[i % 2]});
  }
  return truth;
}

}  // namespace

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
  Priors priors;
  const Rotations truth = two_cameras_each(random, frames, priors);
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

TEST_CASE("robust losses take no notice of outliers where there are priors and rigs, too") {
  Random random;
  INFO(random.replay());
  constexpr Index frames = 25, n = 2 * frames;
  Priors priors;
  const Rotations truth = two_cameras_each(random, frames, priors);
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

// Robust losses on trajectories: odometry that is trusted, or far more precise than loop closures.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

struct Trajectory {
  Rotations truth;
  std::vector<RelativeRotation> measurements;  ///< odometry first
  std::vector<bool> is_odometry, is_wrong;

  MeasurementGraph graph() const { return MeasurementGraph(measurements); }
  MeasurementGraph right_ones() const {
    std::vector<RelativeRotation> right;
    for (std::size_t k = 0; k < measurements.size(); ++k) {
      if (!is_wrong[k]) right.push_back(measurements[k]);
    }
    return MeasurementGraph(right);
  }
};

Trajectory odometry(Random& random, Index n, double sigma) {
  Trajectory t;
  t.truth.push_back(Matrix3::Identity());
  while (static_cast<Index>(t.truth.size()) < n) {
    t.truth.push_back(t.truth.back() * exp_so3(0.1 * random.normal_vector()));
  }
  for (Index i = 0; i + 1 < n; ++i) {
    const Matrix3 exact = t.truth[i].transpose() * t.truth[i + 1];
    t.measurements.push_back(
        {i, i + 1, exact * exp_so3(sigma * random.normal_vector()), 0.5 / (sigma * sigma)});
    t.is_odometry.push_back(true);
    t.is_wrong.push_back(false);
  }
  return t;
}

void close(Random& random, Trajectory& t, Index i, Index j, double sigma, bool wrong) {
  const Matrix3 exact = t.truth[i].transpose() * t.truth[j];
  const Matrix3 seen = exact * exp_so3(sigma * random.normal_vector());
  t.measurements.push_back({i, j, wrong ? random.rotation() : seen, 0.5 / (sigma * sigma)});
  t.is_odometry.push_back(false);
  t.is_wrong.push_back(wrong);
}

/// The mean angle to the truth, where the first nodes agree.
double mean_error(const Rotations& R, const Rotations& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < R.size(); ++i) {
    sum += angle_between(truth[0].transpose() * truth[i], R[0].transpose() * R[i]);
  }
  return sum / static_cast<double>(R.size());
}

struct Found {
  double error = 0.0;
  Index missed = 0, accused = 0;
  std::string reason;
};

Found solve_with(const Trajectory& t, RobustOptions robust, bool trusts) {
  if (trusts) robust.known.trusted = t.is_odometry;
  SolveOptions options;
  options.certify = false;
  const RobustSolution solution = solve_robust(t.graph(), options, robust);
  Found found;
  found.error = mean_error(solution.rotations, t.truth);
  found.reason = solution.reason;
  for (std::size_t k = 0; k < t.is_wrong.size(); ++k) {
    const bool outlier = is_outlier(solution.verdicts.edges[k]);
    found.missed += t.is_wrong[k] && !outlier;
    found.accused += !t.is_wrong[k] && outlier;
  }
  return found;
}

}  // namespace

TEST_CASE("trusted odometry that drifts does not make right closures seem wrong") {
  Random random;
  INFO(random.replay());
  // Rounds of 40 poses, each of which sees that of the round before; and wrong closures.
  constexpr Index n = 800, round = 40;
  constexpr double noise = 0.05;
  Trajectory t = odometry(random, n, noise);
  for (Index i = 0; i + round < n; ++i) close(random, t, i, i + round, noise, false);
  for (int k = 0; k < 230; ++k) {
    const Index i = random.below(n - round - 1);
    close(random, t, i, i + 2 + random.below(n - i - 2), noise, true);
  }
  const double best = mean_error(solve(t.right_ones()).rotations, t.truth);
  for (const Loss loss : {Loss::automatic, Loss::tls, Loss::geman_mcclure}) {
    CAPTURE(static_cast<int>(loss));
    RobustOptions robust;
    robust.loss = loss;
    const Found found = solve_with(t, robust, true);
    CHECK(found.error < 1.5 * best + 0.01);
    CHECK(found.missed <= 3);    // random rotations can be right
    CHECK(found.accused <= 40);  // of 1559
  }
}

TEST_CASE("odometry that is far more precise than closures tells which of these are wrong") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 1500;
  Trajectory t = odometry(random, n, 0.001);
  for (int k = 0; k < 40; ++k) {
    const Index i = random.below(n - 200);
    close(random, t, i, i + 100 + random.below(n - i - 100), 0.01, k % 3 == 0);
  }
  const double best = mean_error(solve(t.right_ones()).rotations, t.truth);
  for (const bool trusts : {false, true}) {
    for (const Loss loss : {Loss::automatic, Loss::tls}) {
      CAPTURE(trusts);
      CAPTURE(static_cast<int>(loss));
      RobustOptions robust;
      robust.loss = loss;
      const Found found = solve_with(t, robust, trusts);
      CHECK(found.error < 1.5 * best + 0.002);
      CHECK(found.missed <= 1);
      CHECK(found.accused <= 4);
      const bool by_precision = found.reason.find("of l1 by precision") != std::string::npos;
      const bool grown = found.reason.find("that bear one another out") != std::string::npos;
      if (!trusts) CHECK((by_precision || grown));
    }
  }
}

TEST_CASE("as many wrong closures as right ones, all off by the same turn, are found with trust") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 1000;
  const Matrix3 alike = exp_so3(Vector3(0.0, 0.0, 1.5));
  Trajectory t = odometry(random, n, 0.005);
  for (int k = 0; k < 200; ++k) {
    const Index i = random.below(n - 60), j = i + 20 + random.below(n - i - 20);
    close(random, t, i, j, 0.02, false);
    if (k % 2 == 0) continue;
    t.measurements.back().i_from_j *= alike;
    t.is_wrong.back() = true;
  }
  const double best = mean_error(solve(t.right_ones()).rotations, t.truth);
  for (const Loss loss : {Loss::automatic, Loss::tls, Loss::cauchy}) {
    CAPTURE(static_cast<int>(loss));
    RobustOptions robust;
    robust.loss = loss;
    const Found found = solve_with(t, robust, true);
    CHECK(found.error < 1.5 * best + 0.002);
    CHECK(found.missed == 0);
    CHECK(found.accused <= 2);
  }
}

TEST_CASE("weights to begin with that are right are kept to on a trajectory") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 1000;
  Trajectory t = odometry(random, n, 0.005);
  for (int k = 0; k < 250; ++k) {
    const Index i = random.below(n - 60);
    close(random, t, i, i + 20 + random.below(n - i - 20), 0.02, k % 5 < 2);
  }
  const double best = mean_error(solve(t.right_ones()).rotations, t.truth);
  for (const Loss loss : {Loss::automatic, Loss::tls, Loss::cauchy}) {
    CAPTURE(static_cast<int>(loss));
    RobustOptions robust;
    robust.loss = loss;
    for (const bool wrong : t.is_wrong) {
      robust.known.initial_weights.push_back(wrong ? 0.0 : 1.0);
    }
    const Found found = solve_with(t, robust, false);
    CHECK(found.error < 1.5 * best + 0.002);
    CHECK(found.missed <= 3);
    CHECK(found.accused <= 2);
  }
}

// How residuals are distributed, and what the automatic loss makes of it.

#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/tails.hpp>
#include <rotavg/robust/thresholds.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/contaminated.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Student's t vector: a normal one over the root of a chi-squared number over its freedom.
Vector3 t_vector(Random& random, int freedom) {
  double chi2 = 0.0;
  for (int k = 0; k < freedom; ++k) {
    const double z = random.normal();
    chi2 += z * z;
  }
  return random.normal_vector() / std::sqrt(chi2 / freedom);
}

/// Squared chords of such noise, a share of them of rotations drawn at random.
std::vector<double> drawn(Random& random, int count, int freedom, double sigma, double share) {
  std::vector<double> x;
  for (int k = 0; k < count; ++k) {
    const bool at_random = random.uniform(0.0, 1.0) < share;
    const double angle = at_random ? angle_between(random.rotation(), Matrix3::Identity())
                                   : sigma * t_vector(random, freedom).norm();
    const double chord = 2.0 * std::sin(0.5 * std::min(angle, 3.14));
    x.push_back(chord * chord);
  }
  return x;
}

}  // namespace

TEST_CASE("freedom, scale and random share of drawn residuals are found") {
  Random random;
  INFO(random.replay());
  for (const int freedom : {1, 2, 4, 60}) {
    for (const double share : {0.0, 0.1, 0.4}) {
      CAPTURE(freedom);
      CAPTURE(share);
      const double sigma = random.power_of_ten(-3.0, -1.5);
      const std::vector<double> x = drawn(random, 20000, freedom, sigma, share);
      const Tails tails = residual_tails(x, noise_scale(x, 20000), 3);
      CHECK(tails.dimension == 3);
      CHECK(tails.sigma == doctest::Approx(sigma).epsilon(0.1));
      CHECK(std::abs(tails.random - share) < 0.03);
      CHECK(tails.are_normal() == (freedom == 60));
      if (freedom < 60) CHECK(std::abs(std::log(tails.freedom / freedom)) < 0.5);
    }
  }
}

TEST_CASE("noise about one axis has one dimension, and half of a normal distribution is normal") {
  Random random;
  INFO(random.replay());
  std::vector<double> x;
  for (int k = 0; k < 5000; ++k) x.push_back(std::pow(0.02 * random.normal(), 2));
  const double noise = noise_scale(x, 5000);
  CHECK(residual_tails(x, noise, 1).are_normal());
  // In space that is no normal noise, but its tails are as short.
  const Tails in_space = residual_tails(x, noise, 3);
  CHECK(in_space.dimension == 1);
  CHECK_FALSE(in_space.are_normal());
  CHECK(in_space.freedom >= 8.0);
}

TEST_CASE("beyond random_beyond() the densities have changed places") {
  Random random;
  INFO(random.replay());
  constexpr double pi = 3.141592653589793;
  for (int trial = 0; trial < 100; ++trial) {
    Tails tails;
    tails.freedom = random.power_of_ten(-0.3, 1.5);
    tails.sigma = random.power_of_ten(-4.0, -1.5);
    tails.random = random.power_of_ten(-3.0, -0.3);
    if (std::isinf(tails.random_beyond())) continue;
    const double r = tails.random_beyond(), nu = tails.freedom, s2 = tails.sigma * tails.sigma;
    const double of_noise = (1.0 - tails.random) * std::tgamma(0.5 * (nu + 3.0)) /
                            std::tgamma(0.5 * nu) / std::pow(nu * pi * s2, 1.5) *
                            std::pow(1.0 + r * r / (nu * s2), -0.5 * (nu + 3.0));
    CHECK(of_noise == doctest::Approx(tails.random / (8.0 * pi * pi)).epsilon(1e-9));
  }
  Tails none;
  none.sigma = 0.01;
  CHECK(std::isinf(none.random_beyond()));
}

TEST_CASE("of drawn noise one in so many is beyond reach(), in one case of ten") {
  Random random;
  INFO(random.replay());
  for (const int freedom : {1, 3, 200}) {
    CAPTURE(freedom);
    Tails tails;
    tails.freedom = freedom;
    tails.sigma = 0.01;
    const double r = tails.reach(100);
    int beyond = 0;
    constexpr int draws = 200000;
    for (int k = 0; k < draws; ++k) beyond += 0.01 * t_vector(random, freedom).norm() > r;
    CHECK(beyond == doctest::Approx(draws / 1000.0).epsilon(0.35));  // 200, give or take 14
    CHECK(tails.reach(10000) > r);
  }
}

TEST_CASE("tails end where residuals become more again") {
  Random random;
  INFO(random.replay());
  std::vector<double> x = drawn(random, 5000, 2, 0.01, 0.0);
  const double noise = noise_scale(x, 5000);
  CHECK(end_of_tails(x, noise) > 5.0 * noise);  // of tails alone nowhere but by chance
  // A hundred wrong edges that are all off by about seven noises are no tail.
  for (int k = 0; k < 100; ++k) {
    x.push_back(std::pow(7.0 * noise * random.uniform(0.97, 1.03), 2));
  }
  const double end = end_of_tails(x, noise);
  CHECK(end >= 3.0 * noise);
  CHECK(end < 6.8 * noise);
  const RobustLoss loss{Loss::cauchy, noise};
  CHECK(thresholds(loss, noise, x, 3).told == doctest::Approx(end).epsilon(1e-12));
}

TEST_CASE("any residuals have tails that are numbers") {
  Random random;
  INFO(random.replay());
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> x(static_cast<std::size_t>(random.below(30)));
    for (double& x_k : x) x_k = random.coin() ? 0.0 : random.power_of_ten(-30.0, 0.6);
    const double noise = random.power_of_ten(-4.0, 0.0);
    const Tails tails = residual_tails(x, noise, random.coin() ? 1 : 3);
    if (x.empty()) continue;
    CHECK(std::isfinite(tails.sigma));
    CHECK((tails.random >= 0.0 && tails.random <= 1.0));
    CHECK_FALSE(std::isnan(tails.random_beyond()));
  }
}

TEST_CASE("of normal noise the automatic loss loses little; of heavy tails it stays sharp") {
  Random random;
  INFO(random.replay());
  const test::Pairs pairs = test::random_connected(random, 100, 1200);
  const auto error_of = [](const Rotations& R, const Rotations& truth) {
    const Matrix3 D = [&] {
      Matrix3 sum = Matrix3::Zero();
      for (std::size_t i = 0; i < R.size(); ++i) sum += truth[i] * R[i].transpose();
      return nearest_rotation(sum);
    }();
    double squares = 0.0;
    for (std::size_t i = 0; i < R.size(); ++i) {
      squares += std::pow(angle_between(D * R[i], truth[i]), 2);
    }
    return std::sqrt(squares);
  };
  double robust = 0.0, told = 0.0;  // told which edges are wrong
  for (int trial = 0; trial < 5; ++trial) {
    const Rotations truth = random.rotations(100);
    std::vector<RelativeRotation> measurements, right;
    for (const auto& [i, j] : pairs) {
      const Matrix3 exact = truth[i].transpose() * truth[j];
      const bool wrong = random.uniform(0.0, 1.0) < 0.2;
      const Matrix3 noisy = exact * exp_so3(0.03 * random.normal_vector());
      measurements.push_back({i, j, wrong ? random.rotation() : noisy, 1.0});
      if (!wrong) right.push_back(measurements.back());
    }
    const RobustSolution solution =
        solve_robust(MeasurementGraph(measurements), {}, RobustOptions{});
    CHECK(solution.loss.kind == Loss::geman_mcclure);
    robust += error_of(solution.rotations, truth);
    told += error_of(solve(MeasurementGraph(right)).rotations, truth);
  }
  CHECK(robust < 1.05 * told);

  const Rotations truth = random.rotations(100);
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : pairs) {
    const Matrix3 exact = truth[i].transpose() * truth[j];
    measurements.push_back({i, j, exact * exp_so3(0.01 * t_vector(random, 2)), 1.0});
  }
  const RobustSolution heavy = solve_robust(MeasurementGraph(measurements), {}, RobustOptions{});
  CHECK(heavy.loss.kind == Loss::cauchy);
  // The tails are no outliers: beyond three noises a twentieth is.
  Index rejected = 0;
  for (const EdgeVerdict verdict : heavy.verdicts.edges) rejected += is_outlier(verdict);
  CHECK(rejected < 30);
}

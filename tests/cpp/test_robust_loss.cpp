#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/robust/gnc.hpp>
#include <rotavg/robust/log1p_of_four.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/loss_of_four.hpp>
#include <rotavg/robust/radix_sort.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/so3/lanes.hpp>

#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

std::vector<RobustLoss> all_losses() {
  std::vector<RobustLoss> losses;
  for (const double c : {1e-3, 0.1, 1.0}) {
    for (const Loss kind : {Loss::l2, Loss::huber, Loss::l1, Loss::l_half, Loss::cauchy,
                            Loss::geman_mcclure, Loss::tls}) {
      losses.push_back({kind, c});
    }
    for (const double mu : {0.1, 1.0, 10.0}) losses.push_back({Loss::tls, c, mu});
  }
  return losses;
}

/// Residuals r about the scale c, away from the bends of huber and tls.
std::vector<double> residuals_about(double c) {
  std::vector<double> r;
  for (const double z : {1e-3, 0.01, 0.11, 0.37, 0.73, 0.93, 1.07, 1.3, 2.7, 11.0, 300.0}) {
    r.push_back(z * c);
  }
  return r;
}

}  // namespace

TEST_CASE("the weight is rho'(r) / (2 r), by central differences") {
  for (const RobustLoss& loss : all_losses()) {
    for (const double r : residuals_about(loss.scale)) {
      CAPTURE(static_cast<int>(loss.kind));
      CAPTURE(loss.mu);
      CAPTURE(r / loss.scale);
      const double h = 1e-5 * r;
      const double slope = (loss.rho((r + h) * (r + h)) - loss.rho((r - h) * (r - h))) / (2.0 * h);
      // rounding of the difference, in units of 2 r
      const double rounding = 1e-15 * loss.rho(r * r) / (h * r);
      CHECK(std::abs(slope / (2.0 * r) - loss.weight(r * r)) <= 1e-8 + rounding);
    }
  }
}

TEST_CASE("losses are r^2 near zero, rise, and lie below the parabola that the weight promises") {
  for (const RobustLoss& loss : all_losses()) {
    CAPTURE(static_cast<int>(loss.kind));
    const double c2 = loss.scale * loss.scale;
    CHECK(loss.rho(0.0) == 0.0);
    CHECK(loss.weight(0.0) == 1.0);
    CHECK(loss.rho(1e-10 * c2) == doctest::Approx(1e-10 * c2).epsilon(1e-9));
    double last = 0.0, last_weight = 1.0;
    for (const double r : residuals_about(loss.scale)) {
      const double x = r * r;
      CHECK(loss.rho(x) >= last);
      CHECK(loss.weight(x) <= last_weight);
      CHECK(loss.weight(x) >= 0.0);
      last = loss.rho(x);
      last_weight = loss.weight(x);
      // Concave in x: what makes reweighting a descent.
      for (const double s : residuals_about(loss.scale)) {
        const double y = s * s;
        const double bound = loss.rho(x) + loss.weight(x) * (y - x);
        CHECK(loss.rho(y) <= bound + 1e-12 * (loss.rho(x) + x + y));
      }
    }
  }
}

TEST_CASE("losses far out, in closed form") {
  const double c = 0.2, r = 1.7, x = r * r, z = x / (c * c);
  CHECK(RobustLoss{Loss::huber, c}.rho(x) == doctest::Approx(2 * c * r - c * c));
  CHECK(RobustLoss{Loss::l1, c}.rho(x) == doctest::Approx(2 * c * c * (std::sqrt(1 + z) - 1)));
  CHECK(RobustLoss{Loss::l_half, c}.rho(x) ==
        doctest::Approx(4 * c * c * (std::pow(1 + z, 0.25) - 1)));
  CHECK(RobustLoss{Loss::cauchy, c}.rho(x) == doctest::Approx(c * c * std::log(1 + z)));
  CHECK(RobustLoss{Loss::geman_mcclure, c}.rho(x) == doctest::Approx(c * c * x / (c * c + x)));
  CHECK(RobustLoss{Loss::tls, c}.rho(x) == c * c);
}

TEST_CASE("graduation ends at the loss, and its surrogates come nearer to it") {
  for (const Loss kind : {Loss::geman_mcclure, Loss::tls}) {
    const RobustLoss loss{kind, 0.1};
    const auto surrogates = graduation(loss);
    REQUIRE(surrogates.size() >= 5);
    for (const double r : {0.05, 0.15, 0.5}) {
      double distance = std::numeric_limits<double>::infinity();
      for (const RobustLoss& surrogate : surrogates) {
        const double now = std::abs(surrogate.rho(r * r) - loss.rho(r * r));
        CHECK(now <= distance + 1e-15);
        distance = now;
      }
    }
    // The first is nowhere sharper than that: in r, its second derivative is at least -2 mu where
    // tls has a kink, and geman_mcclure's is positive as far out as a scale.
    const RobustLoss& first = surrogates.front();
    const double least = kind == Loss::tls ? -2.0 * first.mu : 0.0;
    for (const double r : {0.02, 0.05, 0.09, 0.1}) {
      constexpr double h = 1e-3;
      const double second =
          (first.rho((r + h) * (r + h)) - 2.0 * first.rho(r * r) + first.rho((r - h) * (r - h))) /
          (h * h);
      CHECK(second >= least - 1e-6);
    }
  }
  CHECK(graduation({Loss::cauchy, 0.1}).empty());
}

TEST_CASE("the logarithms of four numbers are those of the library, to a few units") {
  for (double z = 1e-18; z < 1e18; z *= 1.0037) {
    const Lanes four = {z, 0.0, 1.7 * z, 2.9 * z};
    Lanes found;
    log1p_of_four(four, found);
    for (int a = 0; a < 4; ++a) {
      const double expected = std::log1p(four[a]);
      CHECK(std::abs(found[a] - expected) <= 1e-15 * expected);
    }
  }
}

TEST_CASE("what four edges cost and weigh is what each does") {
  for (const RobustLoss& loss : all_losses()) {
    for (const double r : residuals_about(loss.scale)) {
      const Lanes x = {r * r, 0.0, 1e-3 * r * r, 4.0 * r * r};
      const Lanes precision = {1.0, 0.3, 0.0, 40.0};
      Lanes cost, share;
      robust_costs(loss, x, precision, cost);
      weight_shares(loss, x, precision, share);
      for (int a = 0; a < 4; ++a) {
        CHECK(cost[a] == doctest::Approx(robust_cost(loss, x[a], precision[a])).epsilon(1e-14));
        CHECK(share[a] == doctest::Approx(weight_share(loss, x[a], precision[a])).epsilon(1e-14));
      }
    }
  }
}

TEST_CASE("numbers are sorted by their bits as by comparison") {
  Random random;
  INFO(random.replay());
  for (const int count : {0, 1, 499, 500, 501, 3000}) {
    std::vector<double> values;
    for (int k = 0; k < count; ++k) {
      const double any = std::exp(200.0 * random.normal());
      values.push_back(k % 7 == 0 ? 0.0 : k % 5 == 0 ? 0.25 : any);  // zeros, repetitions
    }
    if (count > 10) values[10] = std::numeric_limits<double>::infinity();
    if (count > 11) values[11] = std::numeric_limits<double>::denorm_min();
    std::vector<double> expected = values;
    std::sort(expected.begin(), expected.end());
    radix_sort(values);
    CHECK(values == expected);
  }
  std::vector<double> same(1000, 0.3);
  radix_sort(same);
  CHECK(same == std::vector<double>(1000, 0.3));
}

TEST_CASE("the noise is found among many outliers, and nothing is found where there is none") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.002, 0.05, 0.15}) {
    for (const double outliers : {0.0, 0.3, 0.7}) {
      std::vector<double> x;
      for (int k = 0; k < 20000; ++k) {
        const bool outlier = random.uniform(0.0, 1.0) < outliers;
        const double angle =
            outlier ? log_so3(random.rotation()).norm() : std::abs(noise * random.normal());
        x.push_back(std::pow(2.0 * std::sin(0.5 * angle), 2));
      }
      CAPTURE(noise);
      CAPTURE(outliers);
      CHECK(noise_scale(x, 20000) == doctest::Approx(noise).epsilon(0.08));
      // a quarter of the freedom: half of the residuals
      CHECK(noise_scale(x, 5000) == doctest::Approx(2.0 * noise_scale(x, 20000)));
    }
  }
  // A list whose period the sampling could fall in with.
  std::vector<double> x;
  for (int k = 0; k < 110000; ++k) {
    x.push_back(std::pow((k % 2 == 0 ? 0.01 : 0.04) * random.normal(), 2));
  }
  std::vector<double> shuffled(x);
  for (std::size_t k = shuffled.size(); k > 1; --k) {
    std::swap(shuffled[k - 1],
              shuffled[static_cast<std::size_t>(random.below(static_cast<Index>(k)))]);
  }
  CHECK(noise_scale(x, 110000) == doctest::Approx(noise_scale(shuffled, 110000)).epsilon(0.05));
  CHECK(noise_scale({}, 0) == least_noise);
  CHECK(noise_scale({0.0, 0.0, 1e-30}, 3) == least_noise);
  CHECK(noise_scale({0.1, 0.2}, 0) == least_noise);
}

TEST_CASE("what a spanning tree meets exactly is no sign of little noise, and exact data are") {
  Random random;
  INFO(random.replay());
  constexpr Index tree = 1000, cycles = 1700;
  for (const double outliers : {0.0, 0.4}) {
    CAPTURE(outliers);
    std::vector<double> met(tree, 0.0), exact(tree, 0.0);
    for (Index k = 0; k < cycles; ++k) {
      const bool outlier = random.uniform(0.0, 1.0) < outliers;
      const double wrong = std::pow(random.uniform(0.0, 2.0), 2);
      met.push_back(outlier ? wrong : std::pow(0.03 * random.normal(), 2));
      exact.push_back(outlier ? wrong : 0.0);
    }
    CHECK(noise_scale(met, cycles) < 1e-3);  // the tree's
    CHECK(noise_beside_tree(met, cycles) == doctest::Approx(0.03).epsilon(0.2));
    CHECK(noise_beside_tree(exact, cycles) < 2e-4);
  }
  CHECK(noise_beside_tree({0.0, 0.0}, 0) == least_noise);
}

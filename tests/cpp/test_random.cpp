#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/LU>

#include <rotavg/init/random.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/random.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using rotavg::Matrix3;
using rotavg::random_rotation;
using rotavg::random_unit;
using rotavg::Rotations;
using rotavg::Vector3;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;
constexpr int count = 20000;

/// Kolmogorov's distance between a sample and a distribution function, times sqrt(size): beyond 2.5
/// once in 130 000 draws.
template <typename Distribution>
double kolmogorov(std::vector<double> sample, Distribution&& cdf) {
  std::sort(sample.begin(), sample.end());
  const auto size = static_cast<double>(sample.size());
  double distance = 0.0;
  for (std::size_t k = 0; k < sample.size(); ++k) {
    const double p = cdf(sample[k]);
    const auto rank = static_cast<double>(k);
    distance = std::max({distance, p - rank / size, (rank + 1.0) / size - p});
  }
  return distance * std::sqrt(size);
}

}  // namespace

TEST_CASE("random rotations are rotations") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < count; ++k) {
    const Matrix3 R = random.rotation();
    REQUIRE((R.transpose() * R - Matrix3::Identity()).cwiseAbs().maxCoeff() < 1e-14);
    REQUIRE(R.determinant() > 0.0);
  }
}

TEST_CASE("random rotations have the mean zero, in the trace and in every entry") {
  Random random;
  INFO(random.replay());
  Matrix3 mean = Matrix3::Zero();
  for (int k = 0; k < count; ++k) mean += random.rotation() / count;
  // Under Haar's measure the trace has the variance 1, an entry 1/3.
  CHECK(std::abs(mean.trace()) < 5.0 / std::sqrt(count));
  CHECK(mean.cwiseAbs().maxCoeff() < 5.0 / std::sqrt(3.0 * count));
}

TEST_CASE("angles, axes and columns of random rotations follow Haar's measure") {
  Random random;
  INFO(random.replay());
  const Matrix3 fixed = rotavg::exp_so3({0.3, -1.0, 2.0});
  std::vector<double> angles, axis_heights, column_heights, turned_angles;
  for (int k = 0; k < count; ++k) {
    const Matrix3 R = random.rotation();
    const Vector3 w = rotavg::log_so3(R);
    angles.push_back(w.norm());
    axis_heights.push_back(w.z() / w.norm());
    column_heights.push_back(R(2, 0));
    turned_angles.push_back(rotavg::log_so3(fixed * R).norm());
  }
  const auto angle_cdf = [](double angle) { return (angle - std::sin(angle)) / pi; };
  const auto height_cdf = [](double height) { return 0.5 * (height + 1.0); };
  CHECK(kolmogorov(angles, angle_cdf) < 2.5);
  CHECK(kolmogorov(turned_angles, angle_cdf) < 2.5);
  CHECK(kolmogorov(axis_heights, height_cdf) < 2.5);
  CHECK(kolmogorov(column_heights, height_cdf) < 2.5);
}

TEST_CASE("a seed gives the same numbers on every platform") {
  // The first value of the standard's std::mt19937_64 by default.
  std::mt19937_64 generator;
  CHECK(random_unit(generator) ==
        static_cast<double>(std::uint64_t{14514284786278117030U} >> 11) / 9007199254740992.0);

  std::mt19937_64 first(7), second(7), third(8);
  const Matrix3 R = random_rotation(first);
  CHECK(R == random_rotation(second));
  CHECK(R != random_rotation(third));
  CHECK(R != random_rotation(first));
}

TEST_CASE("uniform numbers lie in [0, 1) and are uniform") {
  Random random;
  INFO(random.replay());
  std::vector<double> numbers;
  for (int k = 0; k < count; ++k) {
    numbers.push_back(random_unit(random.generator()));
    REQUIRE(numbers.back() >= 0.0);
    REQUIRE(numbers.back() < 1.0);
  }
  CHECK(kolmogorov(numbers, [](double x) { return x; }) < 2.5);
}

TEST_CASE("random initial values depend on the seed alone, one rotation for each node") {
  Random random;
  INFO(random.replay());
  const auto graph = simulate_graph(random, rotavg::test::complete(9), 0.1);
  const Rotations R = rotavg::random_init(graph, 3);
  CHECK(R.size() == 9);
  CHECK(R == rotavg::random_init(graph, 3));
  CHECK(R != rotavg::random_init(graph, 4));
  CHECK(R[0] != R[1]);
}

#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string>

#include <rotavg/so3/random.hpp>
#include <rotavg/types.hpp>

namespace rotavg::test {

/// The source of all randomness in the tests. A failing test says how to replay it:
///
///     Random random;
///     INFO(random.replay());
class Random {
 public:
  Random() : seed_(seed_of_environment()), generator_(seed_) {}

  std::string replay() const { return "replay with ROTAVG_TEST_SEED=" + std::to_string(seed_); }

  std::mt19937_64& generator() { return generator_; }
  std::uint64_t seed() { return generator_(); }

  double uniform(double low, double high) { return low + (high - low) * random_unit(generator_); }
  /// 0 … count-1
  Index below(Index count) { return static_cast<Index>(uniform(0.0, count)); }
  bool coin() { return (generator_() >> 63) != 0; }
  /// 10^uniform
  double power_of_ten(double low, double high) { return std::pow(10.0, uniform(low, high)); }

  double normal() {  // Box and Muller
    constexpr double two_pi = 6.283185307179586;
    const double radius = std::sqrt(-2.0 * std::log1p(-random_unit(generator_)));
    return radius * std::cos(two_pi * random_unit(generator_));
  }
  Vector3 normal_vector() {
    const double x = normal(), y = normal(), z = normal();
    return {x, y, z};
  }
  Matrix3 normal_matrix() {
    return Matrix3::NullaryExpr([this](Eigen::Index, Eigen::Index) { return normal(); });
  }

  Vector3 direction() { return normal_vector().normalized(); }
  Matrix3 rotation() { return random_rotation(generator_); }
  Rotations rotations(Index count) {
    Rotations R(static_cast<std::size_t>(count));
    for (Matrix3& R_i : R) R_i = rotation();
    return R;
  }

 private:
  static std::uint64_t seed_of_environment() {
    const char* text = std::getenv("ROTAVG_TEST_SEED");
    return text != nullptr && *text != '\0' ? std::strtoull(text, nullptr, 10) : 20210712;
  }

  std::uint64_t seed_;
  std::mt19937_64 generator_;
};

}  // namespace rotavg::test

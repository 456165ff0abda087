#pragma once

#include <cmath>
#include <cstdint>
#include <random>

#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// A uniform number in [0, 1) with 53 random bits. The standard's distributions may differ between
/// libraries; this gives the same bits everywhere.
inline double random_unit(std::mt19937_64& generator) {
  return static_cast<double>(generator() >> 11) * 0x1.0p-53;
}

/// A rotation drawn uniformly from SO(3) (Shoemake 1992: a uniform unit quaternion from three
/// uniform numbers).
inline Matrix3 random_rotation(std::mt19937_64& generator) {
  constexpr double two_pi = 6.283185307179586476925;
  const double u = random_unit(generator);
  const double a = two_pi * random_unit(generator);
  const double b = two_pi * random_unit(generator);
  const double r = std::sqrt(1.0 - u);
  const double s = std::sqrt(u);
  return Quaternion(s * std::cos(b), r * std::sin(a), r * std::cos(a), s * std::sin(b))
      .normalized()
      .toRotationMatrix();
}

}  // namespace rotavg

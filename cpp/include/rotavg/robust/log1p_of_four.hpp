#pragma once

#include <cstdint>
#include <cstring>

#include <rotavg/so3/lanes.hpp>

namespace rotavg {

/// log(1 + z) of four numbers that are not negative, to a few units in the last place.
///
/// With 1 + z = 2^k m, m from sqrt(1/2) to sqrt(2), log m = 2 artanh(s) with s = (m - 1) / (m + 1),
/// |s| <= .172: of its series s + s^3 / 3 + s^5 / 5 + ... the first term that is left out, s^23 /
/// 23, is 1e-18 of s. What rounding takes off in 1 + z is added to first order.
EIGEN_STRONG_INLINE void log1p_of_four(const Lanes& z, Lanes& result) {
  using Bits = std::uint64_t __attribute__((vector_size(4 * sizeof(std::uint64_t))));
  constexpr std::uint64_t root_half = 0x3fe6a09e667f3bcd;       // the bits of sqrt(1/2)
  constexpr std::uint64_t two_to_52_bits = 0x4330000000000000;  // and of 2^52
  constexpr double two_to_52 = 4503599627370496.0, log_two = 0.69314718055994531;
  const Lanes u = 1.0 + z;
  Bits bits;
  std::memcpy(&bits, &u, sizeof bits);
  const Bits k = (bits - root_half) >> 52, k_bits = k | two_to_52_bits, m_bits = bits - (k << 52);
  Lanes m, exponent;
  std::memcpy(&m, &m_bits, sizeof m);
  std::memcpy(&exponent, &k_bits, sizeof exponent);
  exponent -= two_to_52;
  const Lanes s = (m - 1.0) / (m + 1.0), s2 = s * s;
  Lanes series = s2 * (1.0 / 21.0) + 1.0 / 19.0;
  series = series * s2 + 1.0 / 17.0;
  series = series * s2 + 1.0 / 15.0;
  series = series * s2 + 1.0 / 13.0;
  series = series * s2 + 1.0 / 11.0;
  series = series * s2 + 1.0 / 9.0;
  series = series * s2 + 1.0 / 7.0;
  series = series * s2 + 1.0 / 5.0;
  series = series * s2 + 1.0 / 3.0;
  const Lanes rounded_off = (z - (u - 1.0)) / u;
  result = exponent * log_two + (2.0 * s + (2.0 * s * s2 * series + rounded_off));
}

}  // namespace rotavg

#pragma once

#include <cstdint>
#include <cstring>

#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Four numbers in a register. (By reference only: how they are passed by value depends on the
/// processor that is compiled for.)
using Lanes = double __attribute__((vector_size(4 * sizeof(double))));

/// x, y, z, w of the product p = q b.
EIGEN_STRONG_INLINE void multiply(const Quaternion& q, const WeightedQuaternion& b_xyzw, Lanes& p) {
  Lanes b;
  std::memcpy(&b, b_xyzw.coeffs().data(), sizeof b);
  p = q.w() * b + q.x() * Lanes{1, -1, 1, -1} * Lanes{b[3], b[2], b[1], b[0]} +
      q.y() * Lanes{1, 1, -1, -1} * Lanes{b[2], b[3], b[0], b[1]} +
      q.z() * Lanes{-1, 1, 1, -1} * Lanes{b[1], b[0], b[3], b[2]};
}

/// The four products of four pairs: p[0] holds their x, p[1] their y, p[2] their z, p[3] their w.
EIGEN_STRONG_INLINE void multiply_four(const Lanes (&a)[4], const Lanes (&b)[4], Lanes (&p)[4]) {
  p[0] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
  p[1] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0];
  p[2] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3];
  p[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

/// Rows become columns.
EIGEN_STRONG_INLINE void transpose(Lanes (&a)[4]) {
  const Lanes p = Lanes{a[0][0], a[1][0], a[0][2], a[1][2]};
  const Lanes q = Lanes{a[0][1], a[1][1], a[0][3], a[1][3]};
  const Lanes r = Lanes{a[2][0], a[3][0], a[2][2], a[3][2]};
  const Lanes s = Lanes{a[2][1], a[3][1], a[2][3], a[3][3]};
  a[0] = Lanes{p[0], p[1], r[0], r[1]};
  a[1] = Lanes{q[0], q[1], s[0], s[1]};
  a[2] = Lanes{p[2], p[3], r[2], r[3]};
  a[3] = Lanes{q[2], q[3], s[2], s[3]};
}

/// log(1 + z) of numbers that are not negative, to a few units in the last place.
EIGEN_STRONG_INLINE void log1p_of_four(const Lanes& z, Lanes& result) {
  using Bits = std::uint64_t __attribute__((vector_size(4 * sizeof(std::uint64_t))));
  constexpr std::uint64_t root_half = 0x3fe6a09e667f3bcd;       // the bits of sqrt(1/2)
  constexpr std::uint64_t two_to_52_bits = 0x4330000000000000;  // and of 2^52
  constexpr double two_to_52 = 4503599627370496.0, log_two = 0.69314718055994531;
  // 1 + z = 2^k m with m from sqrt(1/2) to sqrt(2)
  const Lanes u = 1.0 + z;
  Bits bits;
  std::memcpy(&bits, &u, sizeof bits);
  const Bits k = (bits - root_half) >> 52, k_bits = k | two_to_52_bits, m_bits = bits - (k << 52);
  Lanes m, exponent;
  std::memcpy(&m, &m_bits, sizeof m);
  std::memcpy(&exponent, &k_bits, sizeof exponent);
  exponent -= two_to_52;
  // log m = 2 artanh(s)
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

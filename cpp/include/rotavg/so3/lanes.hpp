#pragma once

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

}  // namespace rotavg

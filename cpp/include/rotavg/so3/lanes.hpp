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
  p = q.w() * b + q.x() * Lanes{1, -1, 1, -1} * __builtin_shufflevector(b, b, 3, 2, 1, 0) +
      q.y() * Lanes{1, 1, -1, -1} * __builtin_shufflevector(b, b, 2, 3, 0, 1) +
      q.z() * Lanes{-1, 1, 1, -1} * __builtin_shufflevector(b, b, 1, 0, 3, 2);
}

/// Rows become columns.
EIGEN_STRONG_INLINE void transpose(Lanes (&a)[4]) {
  const Lanes p = __builtin_shufflevector(a[0], a[1], 0, 4, 2, 6);
  const Lanes q = __builtin_shufflevector(a[0], a[1], 1, 5, 3, 7);
  const Lanes r = __builtin_shufflevector(a[2], a[3], 0, 4, 2, 6);
  const Lanes s = __builtin_shufflevector(a[2], a[3], 1, 5, 3, 7);
  a[0] = __builtin_shufflevector(p, r, 0, 1, 4, 5);
  a[1] = __builtin_shufflevector(q, s, 0, 1, 4, 5);
  a[2] = __builtin_shufflevector(p, r, 2, 3, 6, 7);
  a[3] = __builtin_shufflevector(q, s, 2, 3, 6, 7);
}

}  // namespace rotavg

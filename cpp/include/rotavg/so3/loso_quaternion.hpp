#pragma once

#include <cmath>

#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// LOSO (Algorithm 1) in quaternions: the unit q that maximises q^T K q, for a positive
/// semidefinite K = sum p p^T over estimates p (Davenport's matrix). For a unit q,
///
///     4 q^T K q - tr K = tr(M^T R(q)),     M = sum |p|^2 R(p),
///
/// so R(q) is the rotation nearest to M, the minimiser of tr(A X) with A = -M^T.
///
/// Two steps of the power method from a good start are as exact as the next iteration needs, and
/// q^T K q never falls. Where they still move much, because the start is far or the maximum flat,
/// or may have met another eigenvector than the largest, the answer comes from the exact kernel.
inline Quaternion loso(const Matrix4& K, const Quaternion& start) {
  constexpr double much = 0.01;  // radians
  const double trace = (K(0, 0) + K(1, 1)) + (K(2, 2) + K(3, 3));
  if (!(trace > 0.0)) return start;
  Vector4 x = K * start.coeffs();
  x /= trace;
  Vector4 y = K * x;
  y /= trace;
  const double xx = x.squaredNorm(), yy = y.squaredNorm(), xy = x.dot(y);
  // sin^2 of the angle between them; K x may vanish. More than half of the trace is the largest
  // eigenvalue for sure.
  if (xx * yy - xy * xy <= much * much * xx * yy && yy > 0.0625) {
    return Quaternion(Vector4(y / std::sqrt(yy)));
  }
  Matrix3 M;  // as weighted_rotation, with K_ab for the product of a and b
  M << K(0, 0) - K(1, 1) - K(2, 2) + K(3, 3), 2.0 * (K(0, 1) - K(2, 3)),
      2.0 * (K(0, 2) + K(1, 3)),  //
      2.0 * (K(0, 1) + K(2, 3)), K(1, 1) - K(0, 0) - K(2, 2) + K(3, 3),
      2.0 * (K(1, 2) - K(0, 3)),  //
      2.0 * (K(0, 2) - K(1, 3)), 2.0 * (K(1, 2) + K(0, 3)), K(2, 2) - K(0, 0) - K(1, 1) + K(3, 3);
  const Quaternion nearest(nearest_rotation(M));
  const Vector4 K_nearest = K * nearest.coeffs(), Ky = K * y;
  const double value = nearest.coeffs().dot(K_nearest);
  return value * yy >= y.dot(Ky) ? nearest : Quaternion(Vector4(y / std::sqrt(yy)));
}

}  // namespace rotavg

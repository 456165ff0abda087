#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <rotavg/so3/nearest.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// x, y, z, w; of any length. q and -q are the same rotation.
using Quaternion = Eigen::Quaterniond;
using Quaternions = std::vector<Quaternion>;
/// sqrt(w) times a unit quaternion: what is quadratic in it has the weight folded in.
using WeightedQuaternion = Eigen::Quaternion<double, Eigen::DontAlign>;
using Matrix4 = Eigen::Matrix4d;
using Vector4 = Eigen::Vector4d;

inline Quaternion to_quaternion(const Matrix3& R) { return Quaternion(R).normalized(); }

inline Quaternions to_quaternions(const Rotations& R) {
  Quaternions q;
  q.reserve(R.size());
  for (const Matrix3& R_i : R) q.push_back(to_quaternion(R_i));
  return q;
}

/// @param start rotations from which q set out: what has not changed since keeps its bits
inline Rotations to_rotations(const Quaternions& q, const Rotations& start) {
  Rotations R(start);
  for (std::size_t i = 0; i < R.size(); ++i) {
    const bool same = (q[i].coeffs().array() == to_quaternion(R[i]).coeffs().array()).all();
    if (!same) R[i] = q[i].toRotationMatrix();
  }
  return R;
}
inline Rotations to_rotations(const Quaternions& q) {
  Rotations R;
  R.reserve(q.size());
  for (const Quaternion& q_i : q) R.push_back(q_i.toRotationMatrix());
  return R;
}

/// The product a b, from plain arithmetic that the compiler can merge with what is around it.
template <typename A, typename B>
EIGEN_STRONG_INLINE Vector4 product(const A& a, const B& b) {
  return {a.w() * b.x() + a.x() * b.w() + a.y() * b.z() - a.z() * b.y(),
          a.w() * b.y() - a.x() * b.z() + a.y() * b.w() + a.z() * b.x(),
          a.w() * b.z() + a.x() * b.y() - a.y() * b.x() + a.z() * b.w(),
          a.w() * b.w() - a.x() * b.x() - a.y() * b.y() - a.z() * b.z()};
}

template <typename A>
EIGEN_STRONG_INLINE Vector4 conjugated(const A& a) {
  return {-a.x(), -a.y(), -a.z(), a.w()};
}

/// |q|^2 R(q).
template <typename Q>
Matrix3 weighted_rotation(const Q& q) {
  const double xx = q.x() * q.x(), yy = q.y() * q.y(), zz = q.z() * q.z(), ww = q.w() * q.w();
  const double xy = q.x() * q.y(), xz = q.x() * q.z(), yz = q.y() * q.z();
  const double xw = q.x() * q.w(), yw = q.y() * q.w(), zw = q.z() * q.w();
  Matrix3 M;
  M << xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw),  //
      2.0 * (xy + zw), yy - xx - zz + ww, 2.0 * (yz - xw),   //
      2.0 * (xz - yw), 2.0 * (yz + xw), zz - xx - yy + ww;
  return M;
}

/// exp([w]) q, of unit length.
inline Quaternion turned(const Quaternion& q, const Vector3& w) {
  const double half = 0.5 * w.norm();
  // sin(half) / (2 half), by its series where the quotient would lose digits
  const double s = half < 1e-4 ? 0.5 - half * half / 12.0 : 0.5 * std::sin(half) / half;
  const Quaternion step(std::cos(half), s * w.x(), s * w.y(), s * w.z());
  return Quaternion(product(step, q)).normalized();
}

/// |R(a) - R(b)|_F of unit quaternions: 2 sqrt(2) times the sine of half the angle between them.
inline double chordal_distance(const Quaternion& a, const Quaternion& b) {
  const double squared =
      std::min((a.coeffs() - b.coeffs()).squaredNorm(), (a.coeffs() + b.coeffs()).squaredNorm());
  return 2.0 * std::sqrt(2.0 * squared * (1.0 - 0.25 * squared));
}

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
  const double trace = K.trace();
  if (!(trace > 0.0)) return start;
  const Vector4 x = K * start.coeffs() / trace;
  const Vector4 y = K * x / trace;
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
  const double value = nearest.coeffs().dot(K * nearest.coeffs());
  return value * yy >= y.dot(K * y) ? nearest : Quaternion(Vector4(y / std::sqrt(yy)));
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>

#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The skew matrix [w] with [w] x = w × x.
inline Matrix3 hat(const Vector3& w) {
  Matrix3 W;
  W << 0.0, -w.z(), w.y(), w.z(), 0.0, -w.x(), -w.y(), w.x(), 0.0;
  return W;
}

/// The vector of A - A^T: vee(A - A^T) with vee(hat(w)) = w, so twice w for A = hat(w).
inline Vector3 vee_difference(const Matrix3& A) {
  return {A(2, 1) - A(1, 2), A(0, 2) - A(2, 0), A(1, 0) - A(0, 1)};
}

/// The rotation by |w| radians about w (Rodrigues).
inline Matrix3 exp_so3(const Vector3& w) {
  return exp_quaternion(w).normalized().toRotationMatrix();
}

/// exp([w]) R, a rotation to rounding error however often it is turned.
inline Matrix3 turned(const Matrix3& R, const Vector3& w) {
  return renormalized(product(exp_so3(w), R));
}

/// The rotation vector w, |w| <= pi, with exp_so3(w) = R.
inline Vector3 log_so3(const Matrix3& R) {
  const Quaternion q(R);
  const double w = std::abs(q.w());
  Vector3 v(q.x(), q.y(), q.z());
  const double s = v.norm();
  v *= (q.w() < 0.0 ? -1.0 : 1.0) * (s < 1e-9 ? 2.0 / w : 2.0 * std::atan2(s, w) / s);
  return v;
}

/// J^-1 with log(exp(r) exp(d)) = r + J^-1 d to first order in d, |r| <= pi (Chirikjian 2012):
/// I + [r] / 2 + (1 / |r|^2 - cot(|r| / 2) / (2 |r|)) [r]^2.
inline Matrix3 inverse_right_jacobian(const Vector3& r) {
  const double angle = r.norm();
  const double half = 0.5 * angle;
  const double c = angle < 1e-2 ? 1.0 / 12.0 + angle * angle / 720.0
                                : (1.0 - half * std::cos(half) / std::sin(half)) / (angle * angle);
  const Matrix3 W = hat(r);
  Matrix3 J = product(W, W);
  for (int k = 0; k < 9; ++k) J(k) = c * J(k) + 0.5 * W(k);
  add_to_diagonal(J, 1.0);
  return J;
}

/// The angle in radians, 0 … pi, that turns A into B, from the chordal distance |A - B|_F
/// = 2 sqrt(2) sin(angle / 2), which keeps its digits for small angles.
inline double angle_between(const Matrix3& A, const Matrix3& B) {
  const double sine = chordal_distance(A, B) / (2.0 * std::sqrt(2.0));
  if (sine < 0.7) return 2.0 * std::asin(sine);
  return log_so3(transposed_product(A, B)).norm();
}

}  // namespace rotavg

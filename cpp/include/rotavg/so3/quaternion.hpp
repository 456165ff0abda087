#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

using Matrix4 = Eigen::Matrix4d;
using Vector4 = Eigen::Vector4d;

/// A quaternion of any length, stored x, y, z, w. q and -q are the same rotation. What it has of
/// Eigen::Quaternion has the same name and gives the same bits; <Eigen/Geometry> would bring in all
/// of Eigen's dense solvers.
template <int Options>
class BasicQuaternion {
 public:
  using Coefficients = Eigen::Matrix<double, 4, 1, Options>;

  BasicQuaternion() = default;
  BasicQuaternion(double w, double x, double y, double z) : coeffs_(x, y, z, w) {}
  explicit BasicQuaternion(const Vector4& xyzw) : coeffs_(xyzw) {}
  /// Of length 1 if R is a rotation. The largest of the four is found by its square, 4 w^2 = 1 +
  /// tr R or 4 x^2 = 1 + R_00 - R_11 - R_22 …, the others by their products with it.
  explicit BasicQuaternion(const Matrix3& R) {
    const double trace = R(0, 0) + (R(1, 1) + R(2, 2));
    if (trace > 0.0) {
      const double twice = std::sqrt(trace + 1.0), scale = 0.5 / twice;
      coeffs_(0) = (R(2, 1) - R(1, 2)) * scale;
      coeffs_(1) = (R(0, 2) - R(2, 0)) * scale;
      coeffs_(2) = (R(1, 0) - R(0, 1)) * scale;
      coeffs_(3) = 0.5 * twice;
      return;
    }
    int a = R(1, 1) > R(0, 0) ? 1 : 0;
    if (R(2, 2) > R(a, a)) a = 2;
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    const double twice = std::sqrt(R(a, a) - R(b, b) - R(c, c) + 1.0), scale = 0.5 / twice;
    coeffs_(a) = 0.5 * twice;
    coeffs_(b) = (R(b, a) + R(a, b)) * scale;
    coeffs_(c) = (R(c, a) + R(a, c)) * scale;
    coeffs_(3) = (R(c, b) - R(b, c)) * scale;
  }
  static BasicQuaternion Identity() { return {1.0, 0.0, 0.0, 0.0}; }

  double x() const { return coeffs_(0); }
  double y() const { return coeffs_(1); }
  double z() const { return coeffs_(2); }
  double w() const { return coeffs_(3); }
  const Coefficients& coeffs() const { return coeffs_; }
  Coefficients& coeffs() { return coeffs_; }

  bool operator==(const BasicQuaternion& q) const {
    return x() == q.x() && y() == q.y() && z() == q.z() && w() == q.w();
  }
  double squaredNorm() const { return (x() * x() + z() * z()) + (y() * y() + w() * w()); }
  double norm() const { return std::sqrt(squaredNorm()); }
  BasicQuaternion conjugate() const { return {w(), -x(), -y(), -z()}; }
  /// Of length 1; zero stays zero.
  BasicQuaternion normalized() const {
    const double squared = squaredNorm();
    if (!(squared > 0.0)) return *this;
    const double length = std::sqrt(squared);
    return {w() / length, x() / length, y() / length, z() / length};
  }

  /// R(q), of a unit quaternion.
  Matrix3 toRotationMatrix() const {
    const double x2 = 2.0 * x(), y2 = 2.0 * y(), z2 = 2.0 * z();
    const double xw = x2 * w(), yw = y2 * w(), zw = z2 * w();
    const double xx = x2 * x(), xy = y2 * x(), xz = z2 * x();
    const double yy = y2 * y(), yz = z2 * y(), zz = z2 * z();
    Matrix3 R;
    R(0, 0) = 1.0 - (yy + zz);
    R(0, 1) = xy - zw;
    R(0, 2) = xz + yw;
    R(1, 0) = xy + zw;
    R(1, 1) = 1.0 - (xx + zz);
    R(1, 2) = yz - xw;
    R(2, 0) = xz - yw;
    R(2, 1) = yz + xw;
    R(2, 2) = 1.0 - (xx + yy);
    return R;
  }

 private:
  Coefficients coeffs_;
};

using Quaternion = BasicQuaternion<0>;
using Quaternions = LargeVector<Quaternion>;
/// sqrt(w) times a unit quaternion: what is quadratic in it has the weight folded in.
using WeightedQuaternion = BasicQuaternion<Eigen::DontAlign>;

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
    if (!(q[i] == to_quaternion(R[i]))) R[i] = q[i].toRotationMatrix();
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

/// The vector part v of (v, s), and |v|^2.
inline Vector3 vector_part(const Vector4& q) { return {q(0), q(1), q(2)}; }
inline double vector_square(const Vector4& q) { return q(0) * q(0) + q(1) * q(1) + q(2) * q(2); }

/// |q|^2 R(q).
template <typename Q>
EIGEN_STRONG_INLINE Matrix3 weighted_rotation(const Q& q) {
  const double xx = q.x() * q.x(), yy = q.y() * q.y(), zz = q.z() * q.z(), ww = q.w() * q.w();
  const double xy = q.x() * q.y(), xz = q.x() * q.z(), yz = q.y() * q.z();
  const double xw = q.x() * q.w(), yw = q.y() * q.w(), zw = q.z() * q.w();
  Matrix3 M;  // entry by entry: compilers leave a comma initializer a call
  M(0, 0) = xx - yy - zz + ww;
  M(0, 1) = 2.0 * (xy - zw);
  M(0, 2) = 2.0 * (xz + yw);
  M(1, 0) = 2.0 * (xy + zw);
  M(1, 1) = yy - xx - zz + ww;
  M(1, 2) = 2.0 * (yz - xw);
  M(2, 0) = 2.0 * (xz - yw);
  M(2, 1) = 2.0 * (yz + xw);
  M(2, 2) = zz - xx - yy + ww;
  return M;
}

/// The quaternion of the rotation by |w| radians about w.
inline Quaternion exp_quaternion(const Vector3& w) {
  const double half = 0.5 * w.norm();
  // sin(half) / (2 half), by its series where the quotient would lose digits
  const double s = half < 1e-4 ? 0.5 - half * half / 12.0 : 0.5 * std::sin(half) / half;
  return {std::cos(half), s * w.x(), s * w.y(), s * w.z()};
}

/// exp([w]) q, of unit length.
inline Quaternion turned(const Quaternion& q, const Vector3& w) {
  return Quaternion(product(exp_quaternion(w), q)).normalized();
}

/// R moved to the nearest rotation, but for the square of how far it is from one.
inline Matrix3 renormalized(const Matrix3& R) {
  return Quaternion(R).normalized().toRotationMatrix();
}

/// The squared distance of unit quaternions: the smaller one, as q and -q are the same rotation.
inline double squared_distance(const Quaternion& a, const Quaternion& b) {
  double difference = 0.0, sum = 0.0;
  for (int k = 0; k < 4; ++k) {
    const double x = a.coeffs()(k), y = b.coeffs()(k);
    difference += (x - y) * (x - y);
    sum += (x + y) * (x + y);
  }
  return std::min(difference, sum);
}

/// |R(a) - R(b)|_F of unit quaternions: 2 sqrt(2) times the sine of half the angle between them.
inline double chordal_distance(const Quaternion& a, const Quaternion& b) {
  const double squared = squared_distance(a, b);
  return 2.0 * std::sqrt(2.0 * squared * (1.0 - 0.25 * squared));
}

}  // namespace rotavg

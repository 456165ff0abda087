#pragma once

#include <cmath>
#include <vector>

#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

// Gravity is two parallel edges to the world. With Q a rotation that takes g to d, and
// Q' = Q (2 g g^T - I), which turns by pi about d besides, (Q + Q') / 2 = d g^T, so that
//
//     w |R_i Q - R_w|^2 + w |R_i Q' - R_w|^2 = 2 w |R_i d - R_w g|^2 + 8 w.

/// The half turn about a unit vector.
inline Matrix3 half_turn(const Vector3& axis) {
  return 2.0 * axis * axis.transpose() - Matrix3::Identity();
}

/// A rotation that takes the unit vector a to the unit vector b: two half turns, about a and then
/// about the bisector. Where b is nearer to -a, a half turn about what is across comes before, as
/// sums of nearly opposite vectors drown in rounding.
inline Matrix3 rotation_taking(const Vector3& a, const Vector3& b) {
  Index least = 0;
  a.cwiseAbs().minCoeff(&least);
  const Vector3 across = a.cross(Vector3::Unit(least)).normalized();
  const bool flipped = b.dot(a) < 0.0;
  const Vector3 middle = (flipped ? Vector3(b - a) : Vector3(b + a)).normalized();
  const Matrix3 first = flipped ? Matrix3(half_turn(a) * half_turn(across)) : half_turn(a);
  return nearest_rotation(half_turn(middle) * first);
}

/// 2 w |R d - g|^2: what the pair costs but for its constant, 8 w.
inline double gravity_cost(const Matrix3& R, const Vector3& d, const Vector3& g, double w) {
  return 2.0 * w * (R * d - g).squaredNorm();
}

/// The edges of a graph that are gravity: each of these, from a node to the world, and the next
/// one.
struct GravityPairs {
  std::vector<Index> first;         ///< edges, rising
  Vector3 down = Vector3::UnitY();  ///< g, of length 1

  /// What a pair costs at any rotation, 8 w.
  /// @param e residual quaternion of its first edge
  static double constant(const Vector4& e) { return 8.0 * e.squaredNorm(); }
  /// What the pair costs besides. The residual quaternion of the second edge is that of the first,
  /// e = (v, s), times a half turn about g: |v'|^2 = s^2 + |v|^2 - (v . g)^2, so that
  /// 8 |v|^2 + 8 |v'|^2 - 8 w = 8 |v x g|^2.
  double cost(const Vector4& e) const { return 8.0 * e.head<3>().cross(down).squaredNorm(); }
};

/// The rotation about the unit vector g that brings R nearest to the identity, at the largest of
/// tr(exp(phi [g]) R) = const + cos(phi) (tr R - g R g) - sin(phi) g . vee(R - R^T).
inline Matrix3 heading_to_identity(const Matrix3& R, const Vector3& g) {
  const double phi = std::atan2(-g.dot(vee_difference(R)), R.trace() - g.dot(R * g));
  return exp_so3(phi * g);
}

}  // namespace rotavg

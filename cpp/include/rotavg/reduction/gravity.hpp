#pragma once

#include <cmath>

#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

// Gravity is two parallel edges to the world. With Q a rotation that takes g to d, and
// Q' = Q (2 g g^T - I), which turns by pi about d besides, (Q + Q') / 2 = d g^T, so that
//
//     w |R_i Q - R_w|^2 + w |R_i Q' - R_w|^2 = 2 w |R_i d - R_w g|^2 + 8 w.

/// The direction of a finite vector other than zero, however long or short.
inline Vector3 unit_direction(const Vector3& v) {
  return (v / v.cwiseAbs().maxCoeff()).normalized();
}

/// The half turn about a unit vector.
inline Matrix3 half_turn(const Vector3& axis) {
  Matrix3 turn = outer_product(2.0 * axis, axis);
  add_to_diagonal(turn, -1.0);
  return turn;
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

/// The rotation about the unit vector g that brings R nearest to the identity, at the largest of
/// tr(exp(phi [g]) R) = const + cos(phi) (tr R - g R g) - sin(phi) g . vee(R - R^T).
inline Matrix3 heading_to_identity(const Matrix3& R, const Vector3& g) {
  const double phi = std::atan2(-g.dot(vee_difference(R)), R.trace() - g.dot(R * g));
  return exp_so3(phi * g);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
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
  const double largest = std::max({std::abs(v(0)), std::abs(v(1)), std::abs(v(2))});
  return unit({v(0) / largest, v(1) / largest, v(2) / largest});
}

/// The half turn about a unit vector.
inline Matrix3 half_turn(const Vector3& axis) {
  Matrix3 turn = outer_product({2.0 * axis(0), 2.0 * axis(1), 2.0 * axis(2)}, axis);
  add_to_diagonal(turn, -1.0);
  return turn;
}

/// A unit vector at right angles to a unit vector: to it and to the axis that it is the least
/// along.
inline Vector3 any_across(const Vector3& a) {
  int least = 0;
  for (int k = 1; k < 3; ++k) least = std::abs(a(k)) < std::abs(a(least)) ? k : least;
  Vector3 axis(0.0, 0.0, 0.0);
  axis(least) = 1.0;
  return unit(cross(a, axis));
}

/// A rotation that takes the unit vector a to the unit vector b: two half turns, about a and then
/// about the bisector. Where b is nearer to -a, a half turn about what is across comes before, as
/// sums of nearly opposite vectors drown in rounding.
inline Matrix3 rotation_taking(const Vector3& a, const Vector3& b) {
  const bool flipped = dot(b, a) < 0.0;
  const double s = flipped ? -1.0 : 1.0;
  const Vector3 middle = unit({b(0) + s * a(0), b(1) + s * a(1), b(2) + s * a(2)});
  Matrix3 first = half_turn(a);
  if (flipped) first = product(first, half_turn(any_across(a)));
  return nearest_rotation(product(half_turn(middle), first));
}

/// 2 w |R d - g|^2: what the pair costs but for its constant, 8 w.
inline double gravity_cost(const Matrix3& R, const Vector3& d, const Vector3& g, double w) {
  const Vector3 down = product(R, d);
  const Vector3 missed(down(0) - g(0), down(1) - g(1), down(2) - g(2));
  return 2.0 * w * dot(missed, missed);
}

/// The rotation about the unit vector g that brings R nearest to the identity, at the largest of
/// tr(exp(phi [g]) R) = const + cos(phi) (tr R - g R g) - sin(phi) g . vee(R - R^T).
inline Matrix3 heading_to_identity(const Matrix3& R, const Vector3& g) {
  const double trace = R(0, 0) + (R(1, 1) + R(2, 2));
  const double phi = std::atan2(-dot(g, vee_difference(R)), trace - dot(g, product(R, g)));
  return exp_so3({phi * g(0), phi * g(1), phi * g(2)});
}

}  // namespace rotavg

#pragma GCC diagnostic pop

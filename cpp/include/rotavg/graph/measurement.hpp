#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// One measured relative rotation, R_i R_ij ~ R_j, between two nodes known by their ids.
struct RelativeRotation {
  NodeId i = 0;
  NodeId j = 0;
  Matrix3 i_from_j = Matrix3::Identity();  ///< R_ij
  double weight = 1.0;  ///< w_ij, the inverse of the noise's variance up to a factor
};

/// The same with the rotation as a quaternion, of any length but zero.
struct RelativeQuaternion {
  NodeId i = 0;
  NodeId j = 0;
  WeightedQuaternion i_from_j = WeightedQuaternion::Identity();
  double weight = 1.0;
};

/// An edge that no measurement graph can hold: which one (its place in the input) and why.
class InvalidEdge : public std::invalid_argument {
 public:
  InvalidEdge(Index edge, const std::string& reason)
      : std::invalid_argument("edge " + std::to_string(edge) + ": " + reason),
        edge_(edge),
        reason_(reason) {}
  Index edge() const { return edge_; }
  const std::string& reason() const { return reason_; }

 private:
  Index edge_;
  std::string reason_;
};

/// How far max |R^T R - I| may be from zero: more than text with four digits loses.
constexpr double max_orthogonality_error = 1e-3;
/// Up to here a matrix is taken as it is; beyond, it is replaced by the nearest rotation.
constexpr double negligible_orthogonality_error = 2e-15;
/// Weights beyond these bounds would overflow or vanish in the sums.
constexpr double min_weight = 1e-100;
constexpr double max_weight = 1e100;

/// max |R^T R - I|; NaN where R holds one.
inline double orthogonality_error(const Matrix3& R) {
  double error = 0.0;
  for (int a = 0; a < 3; ++a) {
    for (int b = a; b < 3; ++b) {
      const double dot = R(0, a) * R(0, b) + R(1, a) * R(1, b) + R(2, a) * R(2, b);
      const double off = std::abs(dot - (a == b ? 1.0 : 0.0));
      if (std::isnan(off)) return off;
      error = std::max(error, off);
    }
  }
  return error;
}

/// A number as messages show it.
inline std::string six_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

/// @throws InvalidEdge if measurement k joins a node to itself
inline void check_ends(Index k, NodeId i, NodeId j) {
  if (i == j) throw InvalidEdge(k, "it joins a node to itself; expected two different nodes");
}

/// @throws InvalidEdge if the weight of measurement k is out of bounds
inline void check_weight(Index k, double weight) {
  if (weight >= min_weight && weight <= max_weight) return;
  throw InvalidEdge(k, "found the weight " + six_digits(weight) + "; expected a number between " +
                           six_digits(min_weight) + " and " + six_digits(max_weight));
}

/// The quaternion of measurement k, times the square root of its weight.
/// @throws InvalidEdge if an end meets itself, an entry is not finite, the matrix is not a rotation
///         (by more than max_orthogonality_error), or the weight is out of bounds
inline WeightedQuaternion check_measurement(Index k, const RelativeRotation& m) {
  const auto refuse = [k](const std::string& reason) { throw InvalidEdge(k, reason); };

  check_ends(k, m.i, m.j);
  check_weight(k, m.weight);
  const Matrix3& R = m.i_from_j;
  if (!is_finite(R)) refuse("the rotation holds a NaN or an infinity");
  const double error = orthogonality_error(R);
  if (!(error <= max_orthogonality_error)) {
    refuse("the matrix is not a rotation: R^T R differs from the identity by " + six_digits(error) +
           "; expected at most " + six_digits(max_orthogonality_error));
  }
  if (determinant(R) < 0.0) {
    refuse("the matrix is not a rotation: its determinant is " + six_digits(determinant(R)) +
           " (a reflection); expected +1");
  }
  // Snapped to the nearest rotation if rounding has moved it off.
  WeightedQuaternion q(error > negligible_orthogonality_error ? nearest_rotation(R) : R);
  q.coeffs() *= std::sqrt(m.weight) / q.norm();
  return q;
}

/// The same of a quaternion; one that has the right length already keeps its bits.
/// @throws InvalidEdge if an end meets itself, an entry is not finite, all are zero, or the weight
///         is out of bounds
inline WeightedQuaternion check_measurement(Index k, const RelativeQuaternion& m) {
  check_ends(k, m.i, m.j);
  check_weight(k, m.weight);
  WeightedQuaternion q = m.i_from_j;
  double largest = 0.0;
  for (int a = 0; a < 4; ++a) {
    const double size = std::abs(q.coeffs()(a));
    if (!std::isfinite(size)) throw InvalidEdge(k, "the quaternion holds a NaN or an infinity");
    largest = std::max(largest, size);
  }
  if (largest == 0.0) throw InvalidEdge(k, "the quaternion is zero; expected one of length 1");
  if (!(largest > 1e-120 && largest < 1e120)) q.coeffs() /= largest;  // no squares out of range
  const double scale = std::sqrt(m.weight) / q.norm();
  if (std::abs(scale - 1.0) > 1e-15) q.coeffs() *= scale;
  return q;
}

}  // namespace rotavg

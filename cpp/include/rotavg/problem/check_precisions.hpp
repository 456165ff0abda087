#pragma once

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Makes the precision H of measurement k, which a user gave, symmetric.
/// @returns its eigenvalues, rising
/// @param may_be_zero whether a measurement may say nothing
/// @throws InvalidEdge unless it is finite, symmetric, positive semidefinite, and not beyond the
///         bounds of weights
inline Vector3 checked_precision(Index k, Matrix3& H, bool may_be_zero = false) {
  constexpr double slight = 1e-9;
  if (!is_finite(H)) throw InvalidEdge(k, "the precision holds a NaN or an infinity");
  double size = 0.0, skew = 0.0;  // the largest entries
  for (int a = 0; a < 3; ++a) {
    for (int b = 0; b < 3; ++b) {
      size = std::max(size, std::abs(H(a, b)));
      skew = std::max(skew, std::abs(0.5 * H(a, b) - 0.5 * H(b, a)));
    }
  }
  if (size > max_weight) {
    throw InvalidEdge(k, "the precision holds an entry of " + six_digits(size) +
                             "; expected at most " + six_digits(max_weight));
  }
  if (skew > slight * size) throw InvalidEdge(k, "the precision is not symmetric");
  H = symmetric_part(H);
  const Vector3 axes = symmetric_eigen(H).values;
  if ((size == 0.0 && !may_be_zero) || axes(0) < -slight * size) {
    throw InvalidEdge(k, "the precision is zero or has a negative eigenvalue, " +
                             six_digits(axes(0)) + "; expected it positive semidefinite");
  }
  return axes;
}

/// The same of all measurements, which may be zero.
/// @param name of what they are, in messages
/// @throws std::invalid_argument unless there is one for each edge
inline std::vector<Matrix3> checked_precisions(Index num_edges, std::vector<Matrix3> precisions,
                                               const char* name) {
  if (static_cast<Index>(precisions.size()) != num_edges) {
    throw std::invalid_argument("found " + std::to_string(precisions.size()) + " " + name +
                                "; expected " + std::to_string(num_edges) + ", one for each edge");
  }
  for (Index k = 0; k < num_edges; ++k) {
    checked_precision(k, precisions[static_cast<std::size_t>(k)], /*may_be_zero=*/true);
  }
  return precisions;
}

}  // namespace rotavg

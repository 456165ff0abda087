#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Whether a symmetric matrix is finite and positive definite, by its leading minors.
inline bool has_positive_minors(const Matrix3& A) {
  double scale = 0.0;
  for (int k = 0; k < 9; ++k) scale = std::max(scale, std::abs(A(k)));
  if (!is_finite(A) || scale == 0.0) return false;
  const Matrix3 B = A / scale;
  return B(0, 0) > 0.0 && B(0, 0) * B(1, 1) - B(0, 1) * B(1, 0) > 0.0 && determinant(B) > 0.0;
}

/// Inverts a small symmetric positive definite matrix in place, by Gauss and Jordan's steps without
/// exchange of rows. Its pivots are those of a Cholesky factorisation, so that they tell whether it
/// is one.
/// @returns false, and leaves it half done, if a pivot is not positive or not a number
inline bool invert_positive_definite(Eigen::MatrixXd& A) {
  const Eigen::Index n = A.rows();
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(A(k, k) > 0.0)) return false;
    const double inverse = 1.0 / A(k, k);
    for (Eigen::Index j = 0; j < n; ++j) {
      if (j == k) continue;
      const double factor = A(k, j) * inverse;
      for (Eigen::Index i = 0; i < n; ++i) {
        if (i != k) A(i, j) -= A(i, k) * factor;
      }
      A(k, j) = factor;
    }
    for (Eigen::Index i = 0; i < n; ++i) A(i, k) *= -inverse;
    A(k, k) = inverse;
  }
  return true;
}

}  // namespace rotavg

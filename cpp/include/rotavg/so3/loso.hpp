#pragma once

#include <algorithm>
#include <cmath>

#include <rotavg/so3/small_products.hpp>
#include <rotavg/so3/svd.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// LOSO, linear optimisation over SO(3) (paper, Algorithm 1 and Theorem 2):
///
///     argmin tr(A X)  subject to  X^T X = I, det X = 1.
///
/// Contract: for every finite A, whatever its rank or scale, the result is a rotation to rounding
/// error. Where the minimiser is not unique (A = 0; sigma_2 = sigma_3 with det A > 0) one of them
/// is returned. This is the reference that the fast kernel in nearest.hpp is held against.
inline Matrix3 loso(const Matrix3& A) {
  // The minimiser does not depend on the scale of A; the products inside the SVD do.
  double scale = 0.0;
  for (int k = 0; k < 9; ++k) scale = std::max(scale, std::abs(A(k)));
  Matrix3 scaled = A;
  if (scale > 0.0) scaled /= scale;

  // A = U D V^T, singular values falling
  auto [U, D, V] = singular_values(scaled);

  // det U det V = 1: Sigma = diag(-1, -1, +1), the +1 on the smallest singular value.
  // Otherwise V^ = -V and Sigma = I: together Sigma = -I.
  Vector3 Sigma(-1.0, -1.0, 1.0);
  if (determinant(U) * determinant(V) < 0.0) Sigma(2) = -1.0;
  for (int k = 0; k < 9; ++k) V(k) *= Sigma(k / 3);
  return product_transposed(V, U);
}

}  // namespace rotavg

#pragma once

#include <cmath>

#include <Eigen/LU>
#include <Eigen/SVD>

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
  const double scale = A.cwiseAbs().maxCoeff();
  const Matrix3 scaled = scale > 0.0 ? Matrix3(A / scale) : Matrix3::Zero();

  // A = U D V^T, singular values falling
  const Eigen::JacobiSVD<Matrix3> svd(scaled, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3& U = svd.matrixU();
  const Matrix3& V = svd.matrixV();

  // det U det V = 1: Sigma = diag(-1, -1, +1), the +1 on the smallest singular value.
  // Otherwise V^ = -V and Sigma = I.
  if (U.determinant() * V.determinant() > 0.0) {
    return V * Vector3(-1.0, -1.0, 1.0).asDiagonal() * U.transpose();
  }
  return -V * U.transpose();
}

}  // namespace rotavg

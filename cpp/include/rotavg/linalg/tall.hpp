#pragma once

#include <Eigen/Core>

namespace rotavg {

// Products on the calling thread alone: Eigen's general product would start threads of its own
// here, as many as a global setting says. Those of tall matrices with few columns go column by
// column, as fast as memory allows.

/// A^T B.
inline Eigen::MatrixXd inner_products(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  Eigen::MatrixXd result(A.cols(), B.cols());
  for (Eigen::Index j = 0; j < B.cols(); ++j) {
    for (Eigen::Index i = 0; i < A.cols(); ++i) result(i, j) = A.col(i).dot(B.col(j));
  }
  return result;
}

/// A C, for few columns of A and of C.
inline Eigen::MatrixXd combinations(const Eigen::MatrixXd& A, const Eigen::MatrixXd& C) {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(A.rows(), C.cols());
  for (Eigen::Index j = 0; j < C.cols(); ++j) {
    for (Eigen::Index i = 0; i < A.cols(); ++i) result.col(j) += C(i, j) * A.col(i);
  }
  return result;
}

}  // namespace rotavg

#pragma once

#include <algorithm>

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

/// C += s A B, for matrices of any shape: Eigen takes no further threads for targets that are known
/// to have 32 rows at most.
inline void add_product(double s, const Eigen::Ref<const Eigen::MatrixXd>& A,
                        const Eigen::Ref<const Eigen::MatrixXd>& B, Eigen::Ref<Eigen::MatrixXd> C) {
  constexpr int most = 32;
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, most, Eigen::Dynamic>;
  for (Eigen::Index r = 0; r < A.rows(); r += most) {
    const Eigen::Index rows = std::min<Eigen::Index>(most, A.rows() - r);
    Eigen::Map<Rows, 0, Eigen::OuterStride<>> target(C.data() + r, rows, C.cols(),
                                                     Eigen::OuterStride<>(C.outerStride()));
    target.noalias() += s * (A.middleRows(r, rows) * B);
  }
}

}  // namespace rotavg

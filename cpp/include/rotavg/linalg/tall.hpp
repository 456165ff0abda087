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
/// @param c column-major, in memory
template <typename A, typename B, typename C>
void add_product(double s, const A& a, const B& b, C&& c) {
  constexpr int most = 32;
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, most, Eigen::Dynamic>;
  for (Eigen::Index r = 0; r < a.rows(); r += most) {
    const Eigen::Index rows = std::min<Eigen::Index>(most, a.rows() - r);
    Eigen::Map<Rows, 0, Eigen::OuterStride<>> target(c.data() + r, rows, c.cols(),
                                                     Eigen::OuterStride<>(c.outerStride()));
    target.noalias() += s * (a.middleRows(r, rows) * b);
  }
}

}  // namespace rotavg

#pragma once

#include <algorithm>

#include <Eigen/Core>

namespace rotavg {

/// C += s A B on the calling thread alone, for matrices of any shape: Eigen takes no further
/// threads for targets that are known to have 32 rows at most.
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

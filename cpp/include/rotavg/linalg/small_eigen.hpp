#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Core>

namespace rotavg {

/// Eigenvalues, rising, and eigenvectors of a small symmetric matrix.
struct SmallEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;  ///< columns, orthonormal
};

/// The cyclic Jacobi method (Golub and Van Loan, section 8.5), for matrices of some tens of rows at
/// most. Eigen's own solver would be as good, but its templates take every user of these headers
/// seconds to compile.
inline SmallEigen small_eigen(Eigen::MatrixXd A) {
  constexpr int max_sweeps = 60;
  const Eigen::Index n = A.rows();
  Eigen::MatrixXd V = Eigen::MatrixXd::Identity(n, n);
  const double scale = n > 0 ? A.cwiseAbs().maxCoeff() : 0.0;
  for (int sweep = 0; sweep < max_sweeps; ++sweep) {
    double off_diagonal = 0.0;
    for (Eigen::Index p = 0; p < n; ++p) {
      for (Eigen::Index q = p + 1; q < n; ++q) {
        const double a = A(p, q);
        if (!(std::abs(a) > 1e-300 + 1e-18 * scale)) continue;
        off_diagonal = std::max(off_diagonal, std::abs(a));
        // The rotation that makes A(p, q) vanish: t = tan of the smaller angle.
        const double theta = 0.5 * (A(q, q) - A(p, p)) / a;
        const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::hypot(1.0, theta));
        const double c = 1.0 / std::hypot(1.0, t), s = t * c;
        for (Eigen::Index k = 0; k < n; ++k) {
          const double kp = A(k, p), kq = A(k, q);
          A(k, p) = c * kp - s * kq;
          A(k, q) = s * kp + c * kq;
        }
        for (Eigen::Index k = 0; k < n; ++k) {
          const double pk = A(p, k), qk = A(q, k);
          A(p, k) = c * pk - s * qk;
          A(q, k) = s * pk + c * qk;
          const double vp = V(k, p), vq = V(k, q);
          V(k, p) = c * vp - s * vq;
          V(k, q) = s * vp + c * vq;
        }
      }
    }
    if (!(off_diagonal > 1e-16 * scale)) break;
  }
  SmallEigen result{A.diagonal(), V};
  for (Eigen::Index i = 0; i < n; ++i) {  // selection sort
    Eigen::Index smallest = i;
    result.values.tail(n - i).minCoeff(&smallest);
    std::swap(result.values(i), result.values(i + smallest));
    if (smallest > 0) result.vectors.col(i).swap(result.vectors.col(i + smallest));
  }
  return result;
}

}  // namespace rotavg

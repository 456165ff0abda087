#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include <rotavg/types.hpp>

namespace rotavg {

/// Eigenvalues, rising, and eigenvectors (columns) of a symmetric 3 x 3 matrix.
struct SymmetricEigen {
  Vector3 values;
  Matrix3 vectors;
};

/// Jacobi's method (Golub and Van Loan, section 8.5) without anything that is not on the stack, as
/// there is one for every edge. Values are exact to a few roundings of the largest.
inline SymmetricEigen symmetric_eigen(Matrix3 A) {
  constexpr int max_sweeps = 12;
  Matrix3 V = Matrix3::Identity();
  for (int sweep = 0; sweep < max_sweeps; ++sweep) {
    const double off = std::abs(A(0, 1)) + std::abs(A(0, 2)) + std::abs(A(1, 2));
    const double size = std::abs(A(0, 0)) + std::abs(A(1, 1)) + std::abs(A(2, 2));
    if (!(off > 1e-17 * size)) break;
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        const double a = A(p, q);
        if (a == 0.0) continue;
        const double theta = 0.5 * (A(q, q) - A(p, p)) / a;
        const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::hypot(1.0, theta));
        const double c = 1.0 / std::sqrt(1.0 + t * t), s = t * c;
        const int r = 3 - p - q;  // the third row
        A(p, p) -= t * a;
        A(q, q) += t * a;
        A(p, q) = A(q, p) = 0.0;
        const double rp = A(r, p), rq = A(r, q);
        A(r, p) = A(p, r) = c * rp - s * rq;
        A(r, q) = A(q, r) = s * rp + c * rq;
        for (int k = 0; k < 3; ++k) {
          const double vp = V(k, p), vq = V(k, q);
          V(k, p) = c * vp - s * vq;
          V(k, q) = s * vp + c * vq;
        }
      }
    }
  }
  SymmetricEigen result{Vector3(A(0, 0), A(1, 1), A(2, 2)), V};
  for (const auto& [a, b] : {std::pair(0, 1), std::pair(1, 2), std::pair(0, 1)}) {
    if (!(result.values(b) < result.values(a))) continue;
    std::swap(result.values(a), result.values(b));
    for (int k = 0; k < 3; ++k) std::swap(result.vectors(k, a), result.vectors(k, b));
  }
  return result;
}

}  // namespace rotavg

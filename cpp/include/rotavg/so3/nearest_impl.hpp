#pragma once

#include <cmath>
#include <limits>

#include <rotavg/compiled.hpp>
#include <rotavg/so3/loso.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The cofactor matrix: cof(M)^T M = det(M) I.
inline Matrix3 cofactor_matrix(const Matrix3& M) {
  const Vector3 a(M(0, 0), M(1, 0), M(2, 0)), b(M(0, 1), M(1, 1), M(2, 1)),
      c(M(0, 2), M(1, 2), M(2, 2));
  const Vector3 columns[3] = {cross(b, c), cross(c, a), cross(a, b)};
  Matrix3 C;
  for (int k = 0; k < 9; ++k) C(k) = columns[k / 3](k % 3);
  return C;
}

ROTAVG_INLINE Matrix3 nearest_rotation(const Matrix3& M) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  constexpr int max_newton_steps = 12;
  constexpr double min_zeta = 0.01;  // relative to lambda^3; 8/27 for a multiple of a rotation

  const double scale = M.cwiseAbs().maxCoeff();
  if (scale > 0.0) {
    const Matrix3 B = M / scale;
    const Matrix3 C = cofactor_matrix(B);
    const double norm2 = B.squaredNorm();
    const double det = B.col(0).dot(C.col(0));
    const double c0 = norm2 * norm2 - 4.0 * C.squaredNorm();

    double lambda = std::sqrt(3.0 * norm2);
    bool converged = false;
    for (int k = 0; k < max_newton_steps && !converged; ++k) {
      const double x2 = lambda * lambda;
      const double p = (x2 - 2.0 * norm2) * x2 - 8.0 * det * lambda + c0;
      const double slope = 4.0 * lambda * (x2 - norm2) - 8.0 * det;
      if (!(slope > 0.0)) break;
      const double step = p / slope;
      lambda -= step;
      converged = std::abs(step) <= 8.0 * epsilon * lambda;
    }

    const double kappa = 0.5 * (lambda * lambda - norm2);
    const double zeta = kappa * lambda - det;
    if (converged && zeta > min_zeta * lambda * lambda * lambda) {
      const Matrix3 gram = B.transpose() * B;
      Matrix3 X = B * gram;
      for (int k = 0; k < 9; ++k) X(k) = ((kappa + norm2) * B(k) + lambda * C(k) - X(k)) / zeta;
      return renormalized(X);
    }
  }
  Matrix3 A = -M;
  A.transposeInPlace();
  return loso(A);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <rotavg/compiled.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The rotation nearest to M: argmax tr(M^T X) = argmin |X - M|_F over SO(3).
///
/// The maximum is lambda = s1 + s2 + s3, where s3 carries the sign of det M: the largest root of
/// the characteristic polynomial of Davenport's 4 x 4 matrix,
///
///     p(x) = x^4 - 2 |M|^2 x^2 - 8 det(M) x + |M|^4 - 4 |cof M|^2.
///
/// Newton's method from above (sqrt(3) |M|_F >= lambda) falls onto it monotonically, and
///
///     zeta X = (kappa + |M|^2) M + lambda cof(M) - M M^T M,     kappa = (lambda^2 - |M|^2) / 2,
///     zeta = kappa lambda - det M = (s1 + s2)(s2 + s3)(s3 + s1)
///
/// (Markley 1993, "FOAM"). zeta vanishes exactly where the maximiser is not unique, s2 = -s3; near
/// there the formula loses digits and the result comes from Algorithm 1 instead.
///
/// Contract: as loso(); the value tr(M^T X) agrees with the exact one to 1e-12 |M|_F.
ROTAVG_INLINE Matrix3 nearest_rotation(const Matrix3& M);

/// LOSO by the fast kernel: the minimiser of tr(A X) is the rotation nearest to -A^T.
inline Matrix3 loso_fast(const Matrix3& A) {
  Matrix3 M;
  for (int k = 0; k < 9; ++k) M(k) = -A(k / 3, k % 3);
  return nearest_rotation(M);
}

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/so3/nearest_impl.hpp>
#endif

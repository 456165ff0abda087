#pragma once

#include <limits>

namespace rotavg {

/// How the gap is known; of several components, the weakest.
enum class CertificateMethod {
  factorization,  ///< sparse Cholesky factorisation of S with a node removed
  connectivity,   ///< that of the scalar Laplacian outweighs the residuals (connectivity.hpp)
  relaxation,     ///< the optimum of the relaxation (6), proved at a lifted point
  nonnegativity,  ///< f* >= 0, and f(R) is zero to the tolerance
  eigenvalue,     ///< an estimate of the smallest eigenvalue, by Lanczos or LOBPCG
  none,           ///< stopped, or not converged, before anything was known
};

/// What is known of one component: f(R) - f* <= gap, and the smallest eigenvalue of S.
struct ComponentBound {
  CertificateMethod method = CertificateMethod::none;
  double gap = std::numeric_limits<double>::infinity();
  double lambda_min = std::numeric_limits<double>::quiet_NaN();
};

/// A lower bound on what f can be on one component: zero, or the optimum of the relaxation (6).
struct LowerBound {
  double value = 0.0;
  CertificateMethod method = CertificateMethod::nonnegativity;  ///< how it is known
};

}  // namespace rotavg

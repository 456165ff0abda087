#pragma once

#include <limits>

#include <rotavg/linalg/lobpcg.hpp>

namespace rotavg {

/// How the gap is known; of several components, the weakest.
enum class CertificateMethod {
  factorization,  ///< sparse Cholesky factorisation of S with a node removed
  connectivity,   ///< dense Cholesky factorisation: the connectivity outweighs the residuals
  relaxation,     ///< the optimum of the relaxation (6), proved at a lifted point
  nonnegativity,  ///< f* >= 0, and f(R) is zero to the tolerance
  eigenvalue,     ///< LOBPCG estimate of the smallest eigenvalue
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

inline double value_or_nan(const Eigenpair& pair) {
  return pair.converged ? pair.value : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace rotavg

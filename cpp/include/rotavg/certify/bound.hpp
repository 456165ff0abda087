#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <stdexcept>

namespace rotavg {

struct CertificateOptions {
  /// Largest relative gap that is called optimal.
  double tolerance = 1e-6;
  /// Of a proof by a random start, which is tried where a factorisation would cost much more
  /// (certify/random_start.hpp): the chance that it is wrong. Zero: no such proof.
  double failure_probability = 1e-12;
  /// Of that start. Another one draws anew.
  std::uint64_t seed = 0;
  /// No factorisation of the proof takes more operations than this.
  double max_factorization_flops = 1e12;
  int num_threads = 0;
  std::function<bool()> keep_going;  ///< asked every few milliseconds; false stops
};

/// @throws std::invalid_argument for a number out of range
inline void check(const CertificateOptions& options) {
  if (!(options.tolerance >= 0.0)) {
    throw std::invalid_argument(
        "the certificate's tolerance must be a number that is not negative");
  }
  if (!(options.failure_probability >= 0.0 && options.failure_probability < 1.0)) {
    throw std::invalid_argument("the failure probability must be at least 0 and less than 1");
  }
  if (!(options.max_factorization_flops >= 0.0)) {
    throw std::invalid_argument("the limit of a factorisation must be a number, not negative");
  }
}

/// How the gap is known; of several components, the weakest.
enum class CertificateMethod {
  factorization,  ///< sparse Cholesky factorisation of S with a node removed
  connectivity,   ///< that of the scalar Laplacian outweighs the residuals (connectivity.hpp)
  relaxation,     ///< a bound on the optimum of the relaxation (6), proved at a lifted point
  nonnegativity,  ///< f* >= 0, and f(R) is zero to the tolerance
  random_start,   ///< an iteration from a random start, but for a stated probability
  eigenvalue,     ///< an estimate of the smallest eigenvalue, by LOBPCG
  none,           ///< stopped, or not converged, before anything was known
};

/// What is known of one component: f(R) - f* <= gap, and the smallest eigenvalue of S.
struct ComponentBound {
  CertificateMethod method = CertificateMethod::none;
  double gap = std::numeric_limits<double>::infinity();
  double lambda_min = std::numeric_limits<double>::quiet_NaN();
  double rounding = 0.0;  ///< what the gap would be without any leftover, where that is known
  /// Whether S is positive on the complement of its null vectors: then the gap is what the leftover
  /// of the gradient makes of it, and steps towards the optimum close it.
  bool is_definite = false;
  double failure_probability = 0.0;  ///< of the proof; zero of all but random_start
};

/// A lower bound on what f can be on one component: zero, or one on the optimum of the relaxation
/// (6).
struct LowerBound {
  double value = 0.0;
  CertificateMethod method = CertificateMethod::nonnegativity;  ///< how it is known
  bool is_optimum = false;  ///< of the relaxation, to a relative 1e-6
};

}  // namespace rotavg

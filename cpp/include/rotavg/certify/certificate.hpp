#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/factorization.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>

namespace rotavg {

enum class Verdict {
  not_run,
  proved,         ///< the gap is below the tolerance, by a proof
  estimated,      ///< the gap is below the tolerance, by an eigenvalue estimate
  not_certified,  ///< the gap is above the tolerance, or unknown
};

enum class CertificateMethod {
  none,           ///< stopped before anything was known
  factorization,  ///< sparse Cholesky factorisation of S with a node removed
  eigenvalue,     ///< LOBPCG estimate of the smallest eigenvalue
  nonnegativity,  ///< f* >= 0, and f(R) is zero to the tolerance
};

struct CertificateOptions {
  /// Largest relative gap that is called optimal.
  double tolerance = 1e-6;
  /// Where a factorisation would take more operations than this, the smallest eigenvalue is
  /// estimated instead.
  double max_factorization_flops = 2e10;
  int num_threads = 0;
  std::function<bool()> keep_going;  ///< asked every few milliseconds; false stops
};

/// How far the objective at R can be from the global optimum (Theorem 1, and beyond it for points
/// that are not quite stationary).
struct Certificate {
  Verdict verdict = Verdict::not_run;
  CertificateMethod method = CertificateMethod::none;
  /// Smallest eigenvalue of S = Lambda - Rt, Lambda symmetrised; zero to rounding at the optimum.
  /// NaN if the work was stopped before it was known.
  double lambda_min = 0.0;
  /// f(R) - f* <= gap, over all components.
  double gap = std::numeric_limits<double>::infinity();
  /// gap / max(f(R), 1e-6 sum w). Below a root mean square residual of 1e-3 the criterion is
  /// absolute: rounding alone keeps any proof from resolving smaller objectives.
  double relative_gap = std::numeric_limits<double>::infinity();
};

namespace detail {

inline ComponentBound bound_component(const CertificateMatrix& S,
                                      const CertificateOptions& options) {
  using Outcome = SparseCholesky::Outcome;
  if (S.min_factorization_flops() <= options.max_factorization_flops) {
    const SparseSymmetric grounded = S.lower(1);
    SparseCholesky cholesky(grounded);
    if (cholesky.flops() <= options.max_factorization_flops) {
      const Outcome outcome = cholesky.factorize(grounded, 0.0, options.keep_going);
      if (outcome == Outcome::stopped) return {};
      return outcome == Outcome::positive_definite
                 ? bound_by_grounded_factorization(S, cholesky, options.keep_going)
                 : bound_by_shifted_factorization(S, options.keep_going);
    }
  }
  // S is at least theta on the complement of its null vectors N = R^T / sqrt(n), if LOBPCG met the
  // smallest eigenvalue there, and |S N| <= epsilon couples the two: lambda_min(S) is at least the
  // smallest eigenvalue of [0, epsilon; epsilon, theta].
  const Eigenpair pair = min_eigenvalue_on_complement(S, options.keep_going, 0.02, 1000);
  const double theta = pair.value - pair.residual;
  const double epsilon = S.leftover().norm() / std::sqrt(static_cast<double>(S.num_nodes()));
  const double below_zero = 0.5 * (std::hypot(theta, 2.0 * epsilon) - theta);
  if (!pair.converged && pair.value > 0.0) return {};
  ComponentBound bound;
  bound.evidence = Evidence::estimate;
  bound.gap = below_zero * static_cast<double>(S.size()) + S.rounding_trace();
  bound.lambda_min = pair.value < 0.0 ? pair.value : -below_zero;
  return bound;
}

}  // namespace detail

/// gap / max(f, 1e-6 sum w), as Certificate::relative_gap says.
inline double relative_gap(const MeasurementGraph& graph, double gap, double f) {
  return gap / std::max(f, 1e-6 * graph.total_weight());
}

/// Certifies rotations, whether a solver of this library found them or not.
///
/// @param given world_from_i, one rotation per node
/// @throws std::invalid_argument unless `given` holds a rotation for each node
inline Certificate certify(const MeasurementGraph& graph, const Rotations& given,
                           const CertificateOptions& options = {}) {
  const Rotations R = checked_rotations(graph, given);
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());
  const Components components = connected_components(graph);
  const double f = objective(graph, R, num_threads);

  Certificate certificate;
  certificate.lambda_min = std::numeric_limits<double>::infinity();
  double gap = 0.0;
  Evidence evidence = Evidence::proof;  // the weakest of all components
  for (Index c = 0; c < components.size(); ++c) {
    if (components.nodes[c].size() < 2) continue;
    const CertificateMatrix S(graph, R, components, c, num_threads);
    const ComponentBound bound = detail::bound_component(S, options);
    evidence = std::min(evidence, bound.evidence);
    gap += bound.gap;
    // A NaN stays.
    if (!(certificate.lambda_min <= bound.lambda_min)) certificate.lambda_min = bound.lambda_min;
  }
  certificate.method = evidence == Evidence::proof      ? CertificateMethod::factorization
                       : evidence == Evidence::estimate ? CertificateMethod::eigenvalue
                                                        : CertificateMethod::none;
  const bool proof = evidence == Evidence::proof;
  if (!proof && relative_gap(graph, f, f) <= options.tolerance) {
    certificate.method = CertificateMethod::nonnegativity;
    gap = f;
  }
  certificate.gap = std::min(gap, f);  // f* >= 0
  certificate.relative_gap = relative_gap(graph, certificate.gap, f);
  certificate.verdict = !(certificate.relative_gap <= options.tolerance) ? Verdict::not_certified
                        : certificate.method == CertificateMethod::eigenvalue ? Verdict::estimated
                                                                              : Verdict::proved;
  return certificate;
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/connectivity.hpp>
#include <rotavg/certify/factorization.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>

namespace rotavg {

enum class Verdict {
  not_run,
  proved,         ///< the gap is below the tolerance, by a proof
  estimated,      ///< the gap is below the tolerance, by an eigenvalue estimate
  not_certified,  ///< the gap is above the tolerance, or unknown
};

struct CertificateOptions {
  /// Largest relative gap that is called optimal.
  double tolerance = 1e-6;
  /// Where a factorisation would take more operations than this, the smallest eigenvalue is
  /// estimated instead.
  double max_factorization_flops = 5e10;
  int num_threads = 0;
  std::function<bool()> keep_going;  ///< asked every few milliseconds; false stops
};

/// How far the objective at R can be from the global optimum (Theorem 1, and beyond it for points
/// that are not quite stationary).
struct Certificate {
  Verdict verdict = Verdict::not_run;
  CertificateMethod method = CertificateMethod::none;
  /// Smallest eigenvalue of S = Lambda - Rt, Lambda symmetrised; zero to rounding at the optimum.
  /// NaN where it is not known: the work was stopped, or the iteration did not converge.
  double lambda_min = 0.0;
  /// f(R) - f* <= gap, over all components.
  double gap = std::numeric_limits<double>::infinity();
  /// The largest gap / max(f, 1e-6 sum w) of a component. Below a root mean square residual of 1e-3
  /// the criterion is absolute: rounding alone keeps any proof from resolving smaller objectives.
  /// (Where weights differ by more than a factor of 1000, no edge's w counts for more than the
  /// median.)
  double relative_gap = std::numeric_limits<double>::infinity();
};

namespace detail {

/// What the gap of one component is held against.
struct Measure {
  double objective = 0.0;  ///< its part of f(R), plus what rounding can have taken away
  /// Sum of w, where no edge counts for more than 1000 times the lightest: or a few heavy edges
  /// would hide all that the others say.
  double weight = 0.0;

  double relative(double gap) const {
    const double floor = 1e-6 * weight;
    return gap / (objective < floor ? floor : objective);  // NaN where the objective is
  }
};

inline std::vector<Measure> measure_components(const ResidualQuaternions& residuals,
                                               const Components& components) {
  const MeasurementGraph& graph = residuals.graph();
  std::vector<Measure> measures(components.nodes.size());
  std::vector<double> lightest(measures.size(), std::numeric_limits<double>::infinity());
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Index c = components.label[graph.quaternion_edges()[k].i];
    const double weight = residuals()[k].squaredNorm();
    measures[c].objective += 8.0 * residuals()[k].head<3>().squaredNorm();
    measures[c].weight += weight;
    lightest[c] = std::min(lightest[c], weight);
  }
  for (Measure& measure : measures) {
    measure.objective += objective_rounding(measure.weight, measure.objective);
  }
  constexpr double most = 1000.0;
  if (graph.max_weight() <= most * graph.min_weight()) return measures;
  for (Measure& measure : measures) measure.weight = 0.0;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Index c = components.label[graph.quaternion_edges()[k].i];
    measures[c].weight += std::min(residuals()[k].squaredNorm(), most * lightest[c]);
  }
  return measures;
}

inline ComponentBound bound_component(const CertificateMatrix& S, Elimination& elimination,
                                      const CertificateOptions& options) {
  const double limit = options.max_factorization_flops;
  // The connectivity first, where it is worth a try: it takes no longer than the limit, and less
  // than a quarter of the whole factorisation.
  constexpr double not_worth_it = 1e9;
  const double flops = connectivity_flops(S);
  if (flops <= limit && elimination.flops(3, limit) > std::max(4.0 * flops, not_worth_it)) {
    const ComponentBound bound = bound_by_connectivity(S, options.keep_going);
    const bool stopped = options.keep_going && !options.keep_going();
    if (bound.method == CertificateMethod::connectivity || stopped) return bound;
  }
  if (elimination.flops(3, limit) <= limit) {
    BlockCholesky<3> cholesky(elimination.symbolic());
    const auto outcome = cholesky.factorize(S.blocks(elimination), 0.0, options.keep_going);
    if (outcome == CholeskyOutcome::stopped) return {};
    return outcome == CholeskyOutcome::positive_definite
               ? bound_by_grounded_factorization(S, cholesky, options.keep_going)
               : bound_by_shifted_factorization(S, options.keep_going);
  }
  // S is at least theta on the complement of its null vectors N = R^T / sqrt(n), if LOBPCG met the
  // smallest eigenvalue there, and |S N| <= epsilon couples the two: lambda_min(S) is at least the
  // smallest eigenvalue of [0, epsilon; epsilon, theta].
  const Eigenpair pair = min_eigenvalue_on_complement(S, options.keep_going, 0.1, 1000);
  const double theta = pair.value - pair.residual;
  const double epsilon = S.leftover().norm() / std::sqrt(static_cast<double>(S.num_nodes()));
  const double below_zero = 0.5 * (std::hypot(theta, 2.0 * epsilon) - theta);
  ComponentBound bound;
  if (!pair.converged) {  // a negative Rayleigh quotient refutes R all the same
    if (pair.value < 0.0) bound.lambda_min = pair.value;
    return bound;
  }
  bound.method = CertificateMethod::eigenvalue;
  bound.gap = below_zero * static_cast<double>(S.size()) + S.rounding_trace();
  bound.lambda_min = pair.value < 0.0 ? pair.value : -below_zero;
  return bound;
}

}  // namespace detail

/// Certifies rotations.
///
/// @param R world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
inline Certificate certify(const MeasurementGraph& graph, const Rotations& R,
                           const Components& components, std::vector<Elimination>& eliminations,
                           const CertificateOptions& options) {
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());

  const ResidualQuaternions residuals(graph, to_quaternions(R), num_threads);
  const NodeSums sums(residuals);
  const auto measures = detail::measure_components(residuals, components);
  Certificate certificate;
  certificate.gap = certificate.relative_gap = 0.0;
  certificate.lambda_min = std::numeric_limits<double>::infinity();
  certificate.method = CertificateMethod::factorization;
  for (Index c = 0; c < components.size(); ++c) {
    if (components.nodes[c].size() < 2) continue;
    const CertificateMatrix S(sums, components, c);
    const ComponentBound bound = detail::bound_component(S, eliminations[c], options);
    const detail::Measure& measure = measures[c];
    // f* >= 0 is a bound as well, and a proof where nothing is left to gain.
    const bool nothing_left = measure.relative(measure.objective) <= options.tolerance;
    const bool by_nonnegativity = nothing_left && bound.method > CertificateMethod::nonnegativity;
    const auto method = by_nonnegativity ? CertificateMethod::nonnegativity : bound.method;
    const double gap =
        !by_nonnegativity && bound.gap < measure.objective ? bound.gap : measure.objective;
    certificate.method = std::max(certificate.method, method);
    certificate.gap += gap;
    // A NaN stays, here and in lambda_min. That is never positive, as N^T S N = 0.
    const double relative_gap = measure.relative(gap);
    if (!(relative_gap <= certificate.relative_gap)) certificate.relative_gap = relative_gap;
    const double lambda_min = bound.lambda_min > 0.0 ? 0.0 : bound.lambda_min;
    if (!(certificate.lambda_min <= lambda_min)) certificate.lambda_min = lambda_min;
  }
  certificate.verdict = !(certificate.relative_gap <= options.tolerance) ? Verdict::not_certified
                        : certificate.method == CertificateMethod::eigenvalue ? Verdict::estimated
                                                                              : Verdict::proved;
  return certificate;
}

/// Certifies rotations, whether a solver of this library found them or not.
///
/// @param given world_from_i, one rotation per node
/// @throws std::invalid_argument unless `given` holds a rotation for each node
inline Certificate certify(const MeasurementGraph& graph, const Rotations& given,
                           const CertificateOptions& options = {}) {
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  return certify(graph, checked_rotations(graph, given), components, eliminations, options);
}

}  // namespace rotavg

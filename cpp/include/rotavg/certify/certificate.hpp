#pragma once

#include <functional>
#include <limits>
#include <vector>

#include <rotavg/certify/bound.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

class Elimination;

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
/// that are not quite stationary), in one component or over all.
struct ComponentCertificate {
  Verdict verdict = Verdict::not_run;
  CertificateMethod method = CertificateMethod::none;
  /// Smallest eigenvalue of S = Lambda - Rt, Lambda symmetrised; zero to rounding at the optimum.
  /// NaN where it is not known: the work was stopped, or the iteration did not converge.
  double lambda_min = 0.0;
  /// f(R) - f* <= gap.
  double gap = std::numeric_limits<double>::infinity();
  /// gap / max(f, 1e-6 sum w). Below a root mean square residual of 1e-3 the criterion is absolute:
  /// rounding alone keeps any proof from resolving smaller objectives. (No edge's w counts for more
  /// than 1000 times the lightest.)
  double relative_gap = std::numeric_limits<double>::infinity();
};

/// The certificate of a graph: the gap over all components, and for all else the worst of them.
struct Certificate : ComponentCertificate {
  std::vector<ComponentCertificate> components;  ///< in their order
};

/// Certifies rotations.
///
/// @param R world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
/// @param known lower bounds on the optimum of every component; none if empty
/// @param gravity edges whose constant counts for nothing in what the gap is held against
ROTAVG_INLINE Certificate certify(const MeasurementGraph& graph, const Rotations& R,
                                  const Components& components,
                                  std::vector<Elimination>& eliminations,
                                  const CertificateOptions& options,
                                  const std::vector<LowerBound>& known = {},
                                  const GravityPairs& gravity = {});

/// Certifies rotations, whether a solver of this library found them or not.
///
/// @param given world_from_i, one rotation per node
/// @throws std::invalid_argument unless `given` holds a rotation for each node
ROTAVG_INLINE Certificate certify(const MeasurementGraph& graph, const Rotations& given,
                                  const CertificateOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/certify/certificate_impl.hpp>
#endif

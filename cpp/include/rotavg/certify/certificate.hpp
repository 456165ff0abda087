#pragma once

#include <limits>
#include <vector>

#include <rotavg/certify/bound.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

class Elimination;

enum class Verdict {
  not_run,
  proved,         ///< the gap is below the tolerance, by a proof (see failure_probability)
  estimated,      ///< the gap is below the tolerance, by an eigenvalue estimate
  not_certified,  ///< the gap is above the tolerance, or unknown
};

/// What keeps a certificate from the tolerance.
enum class Shortfall {
  none,
  leftover,    ///< S is positive: R is near the optimum, steps towards it or less rounding would do
  negative,    ///< S has a negative eigenvalue: R is not the optimum, or the relaxation not tight
  relaxation,  ///< the gap is the distance to the optimum of the relaxation, which was met
  undecided,   ///< nothing was proved, nor refuted
  stopped,     ///< by keep_going, before anything was
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
  /// gap / max(f, 1e-20 sum w). Below a root mean square residual of 1e-10 rad the criterion is
  /// absolute: the measurements themselves are rounded. (No edge's w counts for more than 1000
  /// times the lightest.)
  double relative_gap = std::numeric_limits<double>::infinity();
  /// The chance that the proof is wrong: zero of all but CertificateMethod::random_start. Of
  /// several components, their sum.
  double failure_probability = 0.0;
  Shortfall shortfall = Shortfall::none;  ///< of several components, of the worst
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

#pragma GCC diagnostic pop

#ifndef ROTAVG_COMPILED
#include <rotavg/certify/certificate_impl.hpp>
#endif

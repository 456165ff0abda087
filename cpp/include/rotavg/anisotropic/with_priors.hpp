#pragma once

#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/certify/certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_precisions.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Measurements with full covariances and priors as one problem on the variables.
ROTAVG_INLINE AnisotropicGraph anisotropic_graph(const GroundedGraph& problem,
                                                 const GroundedPrecisions& precisions);

/// Finds the rotations that fit measurements with full covariances and priors best, from a solution
/// without covariances, and certifies them.
///
/// @param start one rotation for each given node, in the world of the priors
/// @throws std::invalid_argument as solve() of an AnisotropicGraph
ROTAVG_INLINE Solution solve(const GroundedGraph& problem, const GroundedPrecisions& precisions,
                             const SolveOptions& options, const Rotations& start);

/// Bounds how far any rotations are from the optimum of that problem; as certify() of a
/// GroundedGraph.
ROTAVG_INLINE Certificate certify(const GroundedGraph& problem,
                                  const GroundedPrecisions& precisions, const Rotations& given,
                                  const CertificateOptions& options = {});

/// A local minimum of the sum of r^T H r, r = log(R_ij^T R_i^T R_j), with priors, as
/// refine_anisotropic() of a MeasurementGraph. With u the precision of a prior of weight 1, an
/// absolute prior of weight w adds u w |log(P^T R_i)|^2, and gravity u w theta^2, theta the angle
/// between R_i d and g. What rides on a frame or on the world turns its precision with it.
///
/// @param start one rotation for each given node, in the world of the priors
/// @throws InvalidEdge for a precision that is not finite, symmetric and positive semidefinite
/// @throws InvalidRotation, std::invalid_argument unless there is a precision for each given
///         measurement and a rotation for each node
ROTAVG_INLINE IterationResult refine_anisotropic(const GroundedGraph& problem,
                                                 const GroundedPrecisions& precisions,
                                                 const Rotations& start,
                                                 const IterationOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/anisotropic/with_priors_impl.hpp>
#endif

#pragma once

#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/certify/certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_precisions.hpp>
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

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/anisotropic/with_priors_impl.hpp>
#endif

#pragma once

#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/types.hpp>
#include <rotavg/uncertainty/covariance.hpp>

namespace rotavg {

class GroundedGraph;

/// covariances() of pairs of given nodes where measurements and priors are known. Nodes that ride
/// on one variable are known exactly relative to each other.
///
/// @param R (n,) world_from_i where the objective is stationary
/// @param options its free turns are those that gravity leaves, whatever it holds
/// @throws InvalidRotation, InvalidEdge, std::invalid_argument as covariances() of a graph
ROTAVG_INLINE Covariances covariances(const GroundedGraph& problem, const Rotations& R,
                                      const std::vector<NodePair>& pairs,
                                      const CovarianceOptions& options = {});

/// The same of every given node (n,) relative to the world or, where nothing holds its component,
/// to the first variable there. A heading that is free is counted from the first variable of its
/// part.
ROTAVG_INLINE Covariances marginal_covariances(const GroundedGraph& problem, const Rotations& R,
                                               const CovarianceOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/uncertainty/covariance_with_priors_impl.hpp>
#endif

#pragma once

#include <rotavg/certify/certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Bounds how far any rotations are from the global optimum of measurements and priors, whoever
/// found them.
///
/// @param given world_from_i, one rotation per node, in the world of the priors
/// @throws std::invalid_argument unless there is a rotation for each node
/// @throws InvalidRotation for a node that is not where its fixed rotation, or its rig, holds it
ROTAVG_INLINE Certificate certify(const GroundedGraph& problem, const Rotations& given,
                                  const CertificateOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/certify/certify_with_priors_impl.hpp>
#endif

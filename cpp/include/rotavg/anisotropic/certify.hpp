#pragma once

#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

class Elimination;

/// Certifies rotations as the answer to measurements with full covariances: f(R) - f* <= gap.
///
/// The splits of the edges (anisotropic/split.hpp) are those of the closed form; where these do not
/// prove, they are improved by a few steps. What is left then is a bound all the same. Where a
/// factorisation would cost much more than a random start, that is tried first, on the splits in
/// closed form; graphs that neither can prove get the bound f* >= 0.
///
/// @param R world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
/// @param known of the optimum of every component besides; empty if nothing is
ROTAVG_INLINE Certificate certify(const AnisotropicGraph& graph, const Rotations& R,
                                  const Components& components,
                                  std::vector<Elimination>& eliminations,
                                  const CertificateOptions& options,
                                  const std::vector<LowerBound>& known = {});

/// The same for rotations that anybody found.
/// @throws InvalidRotation for a matrix that is none
/// @throws std::invalid_argument unless `given` holds one for each node, and for an option out of
///         range
ROTAVG_INLINE Certificate certify(const AnisotropicGraph& graph, const Rotations& given,
                                  const CertificateOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/anisotropic/certify_impl.hpp>
#endif

#pragma once

#include <vector>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

class Elimination;
class KnownCut;

/// Certifies rotations.
///
/// @param R world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
/// @param known lower bounds on the optimum of every component; none if empty
/// @param gravity edges whose constant counts for nothing in what the gap is held against
/// @param cuts what earlier certificates have proved of every component of the same graph, with the
///        same weights; read and renewed; empty at first; null where nothing is kept
ROTAVG_INLINE Certificate certify(const MeasurementGraph& graph, const Rotations& R,
                                  const Components& components,
                                  std::vector<Elimination>& eliminations,
                                  const CertificateOptions& options,
                                  const std::vector<LowerBound>& known = {},
                                  const GravityPairs& gravity = {},
                                  std::vector<KnownCut>* cuts = nullptr);

/// Certifies rotations, whether a solver of this library found them or not.
///
/// @param given world_from_i, one rotation per node
/// @throws InvalidRotation for a matrix that is none
/// @throws std::invalid_argument unless `given` holds one for each node, and for an option out of
///         range
ROTAVG_INLINE Certificate certify(const MeasurementGraph& graph, const Rotations& given,
                                  const CertificateOptions& options = {});

}  // namespace rotavg

#pragma GCC diagnostic pop

#ifndef ROTAVG_COMPILED
#include <rotavg/certify/certificate_impl.hpp>
#endif

#pragma once

#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// A node is held at this position.
struct FixedPosition {
  NodeId node = 0;
  Vector3 position = Vector3::Zero();
};

/// Where the nodes are, once it is known how they are turned: the positions p that minimise
///
///     sum over the edges of r^T Omega r,     r = R_ij^T (R_i^T (p_j - p_i) - t_ij),
///
/// the translational part of chi^2 as g2o has it (Kuemmerle et al. 2011), for the given R. One
/// sparse factorisation: of the scalar graph Laplacian where every Omega is a multiple of the
/// identity, else of 3 x 3 blocks.
///
/// @param R (n,) world_from_node, in the order of the nodes
/// @param translations (m,) t_ij of the edges: of j in the frame of i
/// @param information (m,) Omega of the edges, in the frame of j as measured: symmetric and
///        positive definite; or none, for the identity
/// @param fixed what is held. In a component without any, the first node is at the origin
/// @returns (n,) in the world that R leads to
/// @throws InvalidRotation for a matrix that is none, InvalidEdge for a translation that is not
///         finite and for information that is not symmetric and positive definite
/// @throws std::invalid_argument for another number of any of these, for what is fixed of no node,
///         twice, or not finite, and where the numbers are too large or too far apart to be solved
ROTAVG_INLINE std::vector<Vector3> positions(const MeasurementGraph& graph, const Rotations& R,
                                             const std::vector<Vector3>& translations,
                                             const std::vector<Matrix3>& information = {},
                                             const std::vector<FixedPosition>& fixed = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/poses/positions_impl.hpp>
#endif

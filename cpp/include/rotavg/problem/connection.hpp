#pragma once

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The connection Laplacian, blockdiag(deg_i I) - Rt, of one component without the nodes that the
/// elimination skips: the quadratic form of (3) over free 3 x 3 matrices.
inline BlockCholesky<3>::Blocks connection_laplacian(const MeasurementGraph& graph,
                                                     Elimination& elimination) {
  return elimination.assemble<3>(
      [&](Index i) -> Matrix3 { return graph.degree(i) * Matrix3::Identity(); },
      [&](Index k) -> Matrix3 { return -weighted_rotation(graph.quaternion_edges()[k].i_from_j); });
}

}  // namespace rotavg

#pragma once

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// blockdiag(diagonal) - Rt for one component, without the nodes that the elimination skips. With
/// the degrees on the diagonal it is the connection Laplacian; with Lambda, the matrix S of Theorem
/// 1.
///
/// @param diagonal the symmetric block of node i: Index -> Matrix3
template <typename Diagonal>
BlockCholesky<3>::Blocks diagonal_minus_measurements(Elimination& elimination,
                                                     Diagonal&& diagonal) {
  return elimination.assemble<3>(diagonal,
                                 [](const Edge& e) -> Matrix3 { return -e.weight * e.i_from_j; });
}

}  // namespace rotavg

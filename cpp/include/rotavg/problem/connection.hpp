#pragma once

#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The connection Laplacian, blockdiag(deg_i I) - Rt, of one component without the nodes that the
/// elimination skips: the quadratic form of (3) over free 3 x 3 matrices.
inline BlockCholesky<3>::Blocks connection_laplacian(const MeasurementGraph& graph,
                                                     Elimination& elimination) {
  return elimination.assemble<3>(
      [&](Index i) -> Matrix3 { return graph.degree(i) * Matrix3::Identity(); },
      [&](Index k) -> Matrix3 { return -weighted_rotation(graph.quaternion_edges()[k].i_from_j); });
}

/// The same in the global frame of some rotations, where its blocks are -E_ij.
inline BlockCholesky<3>::Blocks connection_laplacian(const ResidualQuaternions& residuals,
                                                     Elimination& elimination) {
  return elimination.assemble<3>(
      [&](Index i) -> Matrix3 { return residuals.graph().degree(i) * Matrix3::Identity(); },
      [&](Index k) -> Matrix3 { return -weighted_rotation(Quaternion(residuals()[k])); });
}

/// E X with E the symmetric matrix of the blocks E_ij = w R_i R_ij R_j^T of one component, n nodes:
/// Rt in the global frame.
///
/// @param X 3n x k
inline Eigen::MatrixXd apply_connection(const ResidualQuaternions& residuals,
                                        const Components& components, Index component,
                                        const Eigen::MatrixXd& X) {
  const std::vector<Index>& nodes = components.nodes[component];
  Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
  parallel_for(static_cast<Index>(nodes.size()), residuals.num_threads(), [&](Index a) {
    auto Y_a = Y.middleRows<3>(3 * a);
    for (const HalfEdge& h : residuals.graph().row(nodes[a])) {
      const Quaternion e(residuals()[h.edge()]);
      const Matrix3 E = weighted_rotation(h.is_i() ? e : e.conjugate());
      Y_a += E.lazyProduct(X.middleRows<3>(3 * components.row_in_component[h.node]));
    }
  });
  return Y;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

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
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The connection Laplacian, blockdiag(deg_i I) - Rt, of one component without the nodes that the
/// elimination skips: the quadratic form of (3) over free 3 x 3 matrices.
inline BlockCholesky<3>::Blocks connection_laplacian(const MeasurementGraph& graph,
                                                     Elimination& elimination) {
  return elimination.assemble<3>(
      [&](Index i) { return multiple_of_identity(graph.degree(i)); },
      [&](Index k) -> Matrix3 { return -weighted_rotation(graph.quaternion_edges()[k].i_from_j); });
}

/// The same in the global frame of some rotations, where its blocks are -E_ij.
inline BlockCholesky<3>::Blocks connection_laplacian(const ResidualQuaternions& residuals,
                                                     Elimination& elimination) {
  return elimination.assemble<3>(
      [&](Index i) { return multiple_of_identity(residuals.graph().degree(i)); },
      [&](Index k) -> Matrix3 { return -weighted_rotation(Quaternion(residuals()[k])); });
}

/// Y_a += M X_b, for blocks of three rows of 3n x k matrices.
inline void add_block_product(const Matrix3& M, const Eigen::MatrixXd& X, Index b,
                              Eigen::MatrixXd& Y, Index a) {
  for (Eigen::Index c = 0; c < X.cols(); ++c) {
    const double* const x = X.data() + c * X.rows() + 3 * b;
    double* const y = Y.data() + c * Y.rows() + 3 * a;
    for (int r = 0; r < 3; ++r) y[r] += M(r, 0) * x[0] + M(r, 1) * x[1] + M(r, 2) * x[2];
  }
}

/// X_a^T, of a 3n x 3 matrix.
inline Matrix3 transposed_block(const Eigen::MatrixXd& X, Index a) {
  Matrix3 T;
  for (int k = 0; k < 9; ++k) T(k) = X(3 * a + k / 3, k % 3);
  return T;
}

/// The block E_ij of an edge or, at its other end, E_ij^T.
inline Matrix3 connection_block(const ResidualQuaternions& residuals, Index edge, bool is_i) {
  const Quaternion e(residuals()[edge]);
  return weighted_rotation(is_i ? e : e.conjugate());
}
/// At least the sum of |E_ij| at node i.
inline double connection_degree(const ResidualQuaternions& residuals, Index i) {
  return residuals.graph().degree(i);
}
/// What the rounding of the objective is relative to.
inline double connection_weight(const ResidualQuaternions& residuals) {
  return residuals.graph().total_weight();
}

/// E X with E the symmetric matrix of the blocks E_ij = w R_i R_ij R_j^T of one component, n nodes:
/// Rt in the global frame.
///
/// @tparam Connection ResidualQuaternions or, of other blocks, a class with graph(), num_threads()
///         and these functions: connection_block(), connection_degree(), connection_weight(),
///         connection_laplacian() and lifted_cost() (problem/lifted.hpp)
/// @param X 3n x k
template <typename Connection>
Eigen::MatrixXd apply_connection(const Connection& connection, const Components& components,
                                 Index component, const Eigen::MatrixXd& X) {
  const std::vector<Index>& nodes = components.nodes[component];
  Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
  parallel_for(static_cast<Index>(nodes.size()), connection.num_threads(), [&](Index a) {
    for (const HalfEdge& h : connection.graph().row(nodes[a])) {
      const Matrix3 E = connection_block(connection, h.edge(), h.is_i());
      add_block_product(E, X, components.row_in_component[h.node], Y, a);
    }
  });
  return Y;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

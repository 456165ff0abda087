#pragma once

#include <Eigen/Core>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// One vector per node, n x 3, row by row: gradients, and steps R_i <- exp(w_i) R_i.
using NodeVectors = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

inline Vector3 row_of(const NodeVectors& w, Index i) { return {w(i, 0), w(i, 1), w(i, 2)}; }

/// The Riemannian Hessian of f (3) in the global frame, R_i <- exp(w_i) R_i. With E_ij = R_i R_ij
/// R_j^T,
///
///     (H w)_i = sum_j 2 w_ij [ (tr(E_ij) I - sym E_ij) w_i - (tr(E_ij) I - E_ij^T) w_j ],
///
/// and with sqrt(w_ij) (v, s) its residual quaternion,
///
///     (H w)_i = sum_j 4 [ s^2 d - v (v . d) - s v x w_j ],     d = w_i - w_j,
///
/// and (H w)_j the same with the ends exchanged and v turned round. Where the residuals are small,
/// v ~ 0 and H ~ 4 L (x) I_3 with L the scalar graph Laplacian.
///
/// @param w, result n x 3; result is overwritten
inline void apply_hessian(const ResidualQuaternions& residuals, const NodeVectors& w,
                          NodeVectors& result) {
  const MeasurementGraph& graph = residuals.graph();
  result.resize(w.rows(), 3);
  parallel_for(graph.num_nodes(), residuals.num_threads(), [&](Index i) {
    const Vector3 w_i = row_of(w, i);
    Vector3 sum = Vector3::Zero();
    for (const HalfEdge& h : graph.row(i)) {
      const Vector4& e = residuals()[h.edge()];
      const Vector3 v = vector_part(e), w_j = row_of(w, h.node);
      const Vector3 d = w_i - w_j;
      const double s = h.is_i() ? e.w() : -e.w();
      const Vector3 v_w = cross(v, w_j);
      const double v_d = dot(v, d);
      for (int k = 0; k < 3; ++k) sum(k) += s * (s * d(k) - v_w(k)) - v_d * v(k);
    }
    for (int k = 0; k < 3; ++k) result(i, k) = 4.0 * sum(k);
  });
}

/// The blocks of H of one component without the nodes that the elimination skips: -4 (s^2 I - v v^T
/// + s [v]) for an edge, in the row of its end i and the column of its end j, and on the diagonal
/// sum_j 4 (s^2 I - v v^T).
inline BlockCholesky<3>::Blocks hessian_blocks(const ResidualQuaternions& residuals,
                                               Elimination& elimination) {
  const auto symmetric_part = [&](Index edge) -> Matrix3 {
    const Vector4& e = residuals()[edge];
    const Vector3 v = vector_part(e);
    Matrix3 block = outer_product(-4.0 * v, v);
    add_to_diagonal(block, 4.0 * e.w() * e.w());
    return block;
  };
  return elimination.assemble<3>(
      [&](Index i) {
        Matrix3 sum = Matrix3::Zero();
        for (const HalfEdge& h : residuals.graph().row(i)) sum += symmetric_part(h.edge());
        return sum;
      },
      [&](Index k) -> Matrix3 {
        const Vector4& e = residuals()[k];
        Matrix3 block = hat(vector_part(e));
        block *= 4.0 * e.w();
        block += symmetric_part(k);
        return -block;
      });
}

}  // namespace rotavg

#pragma GCC diagnostic pop

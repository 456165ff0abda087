#pragma once

#include <Eigen/Core>

#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The Riemannian Hessian of f in the global frame, R_i <- exp(w_i) R_i:
///
///     (H w)_i = sum_j 2 [ T (w_i - w_j) - p x w_j ],
///
/// and at the other end with p turned round. Where the residuals are small, p ~ 0, and H is twice
/// the Laplacian whose weights are the precisions.
///
/// @param w, result n x 3; result is overwritten
inline void apply_hessian(const AnisotropicResiduals& residuals, const NodeVectors& w,
                          NodeVectors& result) {
  const AnisotropicGraph& graph = residuals.graph();
  result.resize(w.rows(), 3);
  parallel_for(graph.num_nodes(), residuals.num_threads(), [&](Index i) {
    const Vector3 w_i(w(i, 0), w(i, 1), w(i, 2));
    Vector3 sum = Vector3::Zero();
    for (const HalfEdge& h : graph.row(i)) {
      const EdgeForce& edge = residuals()[h.edge()];
      const Vector3 w_j(w(h.node, 0), w(h.node, 1), w(h.node, 2)), d = w_i - w_j;
      const Vector3 turn = cross(edge.p, w_j);
      sum += edge.T * d;
      if (h.is_i()) {
        sum -= turn;
      } else {
        sum += turn;
      }
    }
    for (int k = 0; k < 3; ++k) result(i, k) = 2.0 * sum(k);
  });
}

/// The blocks of H of one component without the nodes that the elimination skips.
/// @param with_turns whether with p, or without: then it is hardly ever not positive definite
inline BlockCholesky<3>::Blocks hessian_blocks(const AnisotropicResiduals& residuals,
                                               Elimination& elimination, bool with_turns = true) {
  return elimination.assemble<3>(
      [&](Index i) {
        Matrix3 sum = Matrix3::Zero();
        for (const HalfEdge& h : residuals.graph().row(i)) sum += residuals()[h.edge()].T;
        return Matrix3(2.0 * sum);
      },
      [&](Index k) {
        Matrix3 block = residuals()[k].T;
        if (with_turns) block += hat(residuals()[k].p);
        return Matrix3(-2.0 * block);
      });
}

}  // namespace rotavg

#pragma GCC diagnostic pop

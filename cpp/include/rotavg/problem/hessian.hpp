#pragma once

#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// One vector per node, n x 3, row by row: gradients, and steps R_i <- exp(w_i) R_i.
using NodeVectors = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// The Riemannian Hessian of f (3) in the global frame, R_i <- exp(w_i) R_i. With E_ij = R_i R_ij
/// R_j^T,
///
///     (H w)_i = sum_j 2 w_ij [ (tr(E_ij) I - sym E_ij) w_i - (tr(E_ij) I - E_ij^T) w_j ].
///
/// Where the residuals are small, E_ij ~ I and H ~ 4 L (x) I_3 with L the scalar graph Laplacian.
class Hessian {
 public:
  /// @param graph must outlive this object
  Hessian(const MeasurementGraph& graph, const Rotations& R, int num_threads)
      : graph_(graph), num_threads_(num_threads) {
    update(R);
  }

  /// Moves to other rotations.
  void update(const Rotations& R) {
    diagonal_.assign(R.size(), Matrix3::Zero());
    edge_.resize(graph_.edges().size());
    parallel_for(graph_.num_edges(), num_threads_, [&](Index k) {
      const Edge& e = graph_.edges()[k];
      const Matrix3 E = R[e.i] * e.i_from_j * R[e.j].transpose();
      edge_[k] = 2.0 * e.weight * (E.trace() * Matrix3::Identity() - E.transpose());
    });
    parallel_for(graph_.num_nodes(), num_threads_, [&](Index i) {
      for (const HalfEdge& h : graph_.row(i)) {
        diagonal_[i] += 0.5 * (edge_[h.edge] + edge_[h.edge].transpose());
      }
    });
  }

  /// H w.
  NodeVectors apply(const NodeVectors& w) const {
    NodeVectors result(w.rows(), 3);
    parallel_for(graph_.num_nodes(), num_threads_, [&](Index i) {
      Vector3 sum = diagonal_[i] * w.row(i).transpose();
      for (const HalfEdge& h : graph_.row(i)) {
        const Vector3 w_j = w.row(h.node).transpose();
        if (graph_.edges()[h.edge].i == i) {
          sum -= edge_[h.edge] * w_j;
        } else {
          sum -= edge_[h.edge].transpose() * w_j;
        }
      }
      result.row(i) = sum.transpose();
    });
    return result;
  }

 private:
  const MeasurementGraph& graph_;
  int num_threads_;
  std::vector<Matrix3> diagonal_;
  std::vector<Matrix3> edge_;  // minus the block (i, j)
};

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// S = Lambda - Rt (Theorem 1, (5)) of one connected component, n nodes, 3n x 3n, with
///
///     Lambda_i = sym( sum_j Rt_ij R_j^T R_i ),
///
/// symmetrised block by block, so that tr(Lambda) = tr(R Rt R^T) at any R, stationary or not.
/// At a stationary point S R^T = 0; elsewhere S R^T is the leftover of the gradient.
class CertificateMatrix {
 public:
  /// @param graph, R, components must outlive this object
  CertificateMatrix(const MeasurementGraph& graph, const Rotations& R, const Components& components,
                    Index component, int num_threads)
      : graph_(graph),
        R_(R),
        components_(components),
        component_(component),
        nodes_(components.nodes[component]),
        num_threads_(num_threads),
        lambda_(nodes_.size()),
        skew_(nodes_.size()) {
    parallel_for(num_nodes(), num_threads_, [&](Index a) {
      const Index i = nodes_[a];
      const Matrix3 M = -linear_cost(graph_, R_, i) * R_[i];  // sum_j Rt_ij R_j^T R_i
      lambda_[a] = 0.5 * (M + M.transpose());
      skew_[a] = 0.5 * (M - M.transpose());
    });
  }

  const MeasurementGraph& graph() const { return graph_; }
  const Components& components() const { return components_; }
  Index component() const { return component_; }
  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  Eigen::Index size() const { return 3 * static_cast<Eigen::Index>(num_nodes()); }

  /// S X, without forming S.
  Eigen::MatrixXd apply(const Eigen::MatrixXd& X) const {
    Eigen::MatrixXd Y(X.rows(), X.cols());
    parallel_for(num_nodes(), num_threads_, [&](Index a) {
      auto Y_a = Y.middleRows<3>(3 * a);
      Y_a = lambda_[a].lazyProduct(X.middleRows<3>(3 * a));
      for (const HalfEdge& h : graph_.row(nodes_[a])) {
        Y_a -= h.block.lazyProduct(X.middleRows<3>(3 * components_.row_in_component[h.node]));
      }
    });
    return Y;
  }

  /// D^-1 X with D the weighted degrees: the simplest preconditioner.
  Eigen::MatrixXd divide_by_degree(Eigen::MatrixXd X) const {
    for (Index a = 0; a < num_nodes(); ++a) X.middleRows<3>(3 * a) /= graph_.degree(nodes_[a]);
    return X;
  }

  /// R^T, 3n x 3: the null vectors of S at a stationary point.
  Eigen::MatrixXd null_vectors() const {
    Eigen::MatrixXd N(size(), 3);
    for (Index a = 0; a < num_nodes(); ++a) N.middleRows<3>(3 * a) = R_[nodes_[a]].transpose();
    return N;
  }

  /// S R^T, 3n x 3, from the skew parts that Lambda lost: -skew(sum_j Rt_ij R_j^T R_i) R_i^T.
  /// Its Frobenius norm is sqrt(2) / 4 times the norm of the gradient.
  Eigen::MatrixXd leftover() const {
    Eigen::MatrixXd K(size(), 3);
    for (Index a = 0; a < num_nodes(); ++a) {
      K.middleRows<3>(3 * a) = -skew_[a] * R_[nodes_[a]].transpose();
    }
    return K;
  }

  /// A bound on what rounding in Lambda, in the leftover and in the blocks of Rt adds to tr(S Y)
  /// for feasible Y: at a node with q edges, q + 10 roundings of nine entries of size deg, eight
  /// times over for what multiplies them.
  double rounding_trace() const {
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    double sum = 0.0;
    for (const Index i : nodes_) sum += 72.0 * (graph_.row(i).size() + 10) * graph_.degree(i);
    return unit * sum;
  }

  double max_degree() const {
    double largest = 0.0;
    for (const Index i : nodes_) largest = std::max(largest, graph_.degree(i));
    return largest;
  }

  /// S without the nodes that the elimination skips.
  BlockCholesky<3>::Blocks blocks(Elimination& elimination) const {
    return diagonal_minus_measurements(elimination, [this](Index i) -> const Matrix3& {
      return lambda_[components_.row_in_component[i]];
    });
  }

 private:
  const MeasurementGraph& graph_;
  const Rotations& R_;
  const Components& components_;
  Index component_;
  const std::vector<Index>& nodes_;
  int num_threads_;
  std::vector<Matrix3> lambda_, skew_;
};

}  // namespace rotavg

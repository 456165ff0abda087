#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/cholesky.hpp>
#include <rotavg/problem/hessian.hpp>

namespace rotavg {

/// (4 L)^-1 with L the scalar graph Laplacian, the first node of every component held: the metric
/// in which f is nearly round, factored once.
class LaplacianMetric {
 public:
  /// Analyses; factorize() does the work.
  LaplacianMetric(const MeasurementGraph& graph, const Components& components)
      : free_nodes_(components.free_nodes()),
        laplacian_(grounded_laplacian(graph, free_nodes_)),
        cholesky_(laplacian_) {}

  /// Operations that the factorisation takes.
  double flops() const { return cholesky_.flops(); }

  SparseCholesky::Outcome factorize(const std::function<bool()>& keep_going) {
    return cholesky_.factorize(laplacian_, 0.0, keep_going);
  }

  /// (4 L)^-1 v; zero at the held nodes.
  NodeVectors apply(const NodeVectors& v) {
    Eigen::MatrixXd free(laplacian_.rows(), 3);
    for (Eigen::Index k = 0; k < free.rows(); ++k) free.row(k) = 0.25 * v.row(free_nodes_[k]);
    free = cholesky_.solve(free);
    NodeVectors result = NodeVectors::Zero(v.rows(), 3);
    for (Eigen::Index k = 0; k < free.rows(); ++k) result.row(free_nodes_[k]) = free.row(k);
    return result;
  }

 private:
  std::vector<Index> free_nodes_;
  SparseSymmetric laplacian_;
  SparseCholesky cholesky_;
};

}  // namespace rotavg

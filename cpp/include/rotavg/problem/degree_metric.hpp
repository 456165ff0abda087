#pragma once

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/hessian.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// (4 D)^-1 with D the diagonal of the scalar graph Laplacian L, the degrees: Jacobi's
/// preconditioner, for graphs whose L is too large to be factored. With kappa the condition number
/// of D^-1/2 L D^-1/2, conjugate gradients need O(sqrt(kappa)) steps, where sweeps need O(kappa).
class DegreeMetric {
 public:
  /// @param graph must outlive this object
  DegreeMetric(const MeasurementGraph& graph, int num_threads)
      : graph_(graph), num_threads_(num_threads) {}

  /// (4 D)^-1 v; zero at nodes without edges.
  void apply(const NodeVectors& v, NodeVectors& result) const {
    result.resize(v.rows(), 3);
    parallel_for(graph_.num_nodes(), num_threads_, [&](Index i) {
      const double degree = graph_.degree(i);
      for (int k = 0; k < 3; ++k) result(i, k) = degree > 0.0 ? 0.25 * v(i, k) / degree : 0.0;
    });
  }

 private:
  const MeasurementGraph& graph_;
  int num_threads_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

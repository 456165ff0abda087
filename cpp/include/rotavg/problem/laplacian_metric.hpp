#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/hessian.hpp>

namespace rotavg {

/// (4 L)^-1 with L the scalar graph Laplacian, the first node of every component held: the metric
/// in which f is nearly round, factored once.
class LaplacianMetric {
 public:
  /// @param eliminations of all components, without their roots; must outlive this object
  LaplacianMetric(const MeasurementGraph& graph, std::vector<Elimination>& eliminations)
      : graph_(graph), eliminations_(eliminations) {}

  /// Operations that the factorisation takes; where they are certainly more than `limit`, a lower
  /// bound that is.
  double flops(double limit) {
    double sum = 0.0;
    for (Elimination& elimination : eliminations_) {
      sum += elimination.flops(1, limit);
      if (sum > limit) break;
    }
    return sum;
  }

  CholeskyOutcome factorize(const std::function<bool()>& keep_going) {
    return factorize(graph_.weights(), keep_going);
  }
  /// The same with other weights (m,).
  CholeskyOutcome factorize(const std::vector<double>& weights,
                            const std::function<bool()>& keep_going) {
    factors_.clear();
    for (Elimination& elimination : eliminations_) {
      if (elimination.size() == 0) continue;
      factors_.push_back(
          {&elimination, BlockCholesky<1>(elimination.symbolic(), elimination.num_threads())});
      const auto outcome = factors_.back().cholesky.factorize(
          grounded_laplacian(graph_, elimination, weights), 0.0, keep_going);
      if (outcome != CholeskyOutcome::positive_definite) return outcome;
    }
    return CholeskyOutcome::positive_definite;
  }

  /// (4 L)^-1 v; zero at the held nodes.
  void apply(const NodeVectors& v, NodeVectors& result) {
    result.setZero(v.rows(), 3);
    for (Factor& factor : factors_) {
      const Elimination& elimination = *factor.elimination;
      factor.cholesky.solve_entries(
          3, [&](Index a, int c) { return 0.25 * v(elimination.node(a), c); },
          [&](Index a, int c, double solved) { result(elimination.node(a), c) = solved; });
    }
  }

 private:
  struct Factor {
    const Elimination* elimination;
    BlockCholesky<1> cholesky;
  };

  const MeasurementGraph& graph_;
  std::vector<Elimination>& eliminations_;
  std::vector<Factor> factors_;
};

}  // namespace rotavg

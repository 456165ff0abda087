#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/so3/quaternion.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The squared chords r^2 = 4 sin^2(angle / 2) of the residual angles (m,), 0 to 4, whatever the
/// weights.
inline void squared_residuals(const ResidualQuaternions& residuals, std::vector<double>& x) {
  const auto& e = residuals();
  x.resize(e.size());
  parallel_for(static_cast<Index>(e.size()), residuals.num_threads(), [&](Index k) {
    const double v2 = e[k].head<3>().squaredNorm();
    x[k] = 4.0 * v2 / (v2 + e[k].w() * e[k].w());
  });
}

/// 2 sum w ((1 - s) rho(r^2) + s r^2) with s the least share: the objective (3) for the loss l2.
/// @param precision (m,) in whose units the residuals are judged; empty: all 1
inline double robust_objective(const std::vector<double>& weights, const std::vector<double>& x,
                               const RobustLoss& loss, const std::vector<double>& precision,
                               int num_threads) {
  return block_sum<double>(static_cast<Index>(x.size()), num_threads, [&](Index k) {
    return 2.0 * weights[k] * robust_cost(loss, x[k], precision_of(precision, k));
  });
}

/// The weights w ((1 - s) d rho / d x + s) of the least squares that bound this objective.
inline void robust_weights(const std::vector<double>& weights, const std::vector<double>& x,
                           const RobustLoss& loss, const std::vector<double>& precision,
                           int num_threads, std::vector<double>& result) {
  result.resize(x.size());
  parallel_for(static_cast<Index>(x.size()), num_threads, [&](Index k) {
    const double share = weight_share(loss, x[k], precision_of(precision, k));
    result[k] = std::max(min_weight, weights[k] * share);
  });
}

/// The same for the residuals of a graph with the given weights.
inline std::vector<double> robust_weights(const MeasurementGraph& graph, const Quaternions& q,
                                          const RobustLoss& loss,
                                          const std::vector<double>& precision, int num_threads) {
  std::vector<double> x, result;
  squared_residuals(ResidualQuaternions(graph, q, num_threads), x);
  robust_weights(graph.weights(), x, loss, precision, num_threads, result);
  return result;
}

/// The robust objective and its gradient, from one pass over the edges.
class RobustResiduals {
 public:
  /// @param graph with the given weights; must outlive this object
  /// @param precision (m,) in whose units the residuals are judged; empty: all 1; must outlive it
  RobustResiduals(const MeasurementGraph& graph, const std::vector<double>& precision,
                  int num_threads)
      : graph_(&graph),
        precision_(&precision),
        num_threads_(num_threads),
        pull_(graph.edges().size()) {}

  /// Moves to other rotations, or another loss.
  void update(const Quaternions& q, const RobustLoss& loss) {
    objective_ = block_sum<double>(graph_->num_edges(), num_threads_, [&, loss](Index k) {
      const Vector4 e = residual_quaternion(graph_->quaternion_edges()[k], q);
      const double v2 = e.head<3>().squaredNorm(), weight = v2 + e.w() * e.w();
      const double x = 4.0 * v2 / weight, precision = precision_of(*precision_, k);
      const double share = weight_share(loss, x, precision);
      pull_[k] << share * e.w() * e.head<3>(), share * weight;
      return weight * robust_cost(loss, x, precision);
    });
    objective_ *= 2.0;
  }

  double objective() const { return objective_; }

  /// Of the weighted problem, and so of the robust one.
  GradientNorm gradient_norm() const {
    const auto sums = block_sum<GradientSums>(graph_->num_nodes(), num_threads_, [&](Index l) {
      if (graph_->row(l).size() == 0) return GradientSums{};
      Vector4 sum = Vector4::Zero();
      for (const HalfEdge& h : graph_->row(l)) {
        const Vector4& pull = pull_[h.edge()];
        sum.head<3>() += (h.is_i() ? 1.0 : -1.0) * pull.head<3>();
        sum.w() += pull.w();
      }
      const double square = 64.0 * sum.head<3>().squaredNorm();
      return GradientSums{square, std::sqrt(square) / sum.w()};
    });
    return {std::sqrt(sums.squares), sums.largest};
  }

 private:
  const MeasurementGraph* graph_;
  const std::vector<double>* precision_;
  int num_threads_;
  LargeVector<Vector4> pull_;  ///< (m,) an eighth of the gradient at i, and the weight
  double objective_ = 0.0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

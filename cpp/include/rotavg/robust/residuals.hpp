#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/loss_of_four.hpp>
#include <rotavg/so3/lanes.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The squared chord r^2 = 4 sin^2(angle / 2), 0 to 4, of a residual quaternion of any length.
inline double squared_chord(const Vector4& e) {
  const double v2 = vector_square(e);
  return 4.0 * v2 / (v2 + e.w() * e.w());
}

/// That between two rotations, |A - B|_F^2 / 2.
inline double squared_chord(const Matrix3& A, const Matrix3& B) {
  return std::max(0.0, 3.0 - A.cwiseProduct(B).sum());
}

/// That of all edges (m,).
inline void squared_residuals(const MeasurementGraph& graph, const Quaternions& q, int num_threads,
                              std::vector<double>& x) {
  x.resize(graph.edges().size());
  parallel_for(graph.num_edges(), num_threads, [&](Index k) {
    x[k] = squared_chord(residual_quaternion(graph.quaternion_edges()[k], q));
  });
}

/// (m,) the same at the rotations R, world_from_i.
inline std::vector<double> squared_residuals(const MeasurementGraph& graph, const Rotations& R,
                                             int num_threads) {
  std::vector<double> x;
  squared_residuals(graph, to_quaternions(R), num_threads, x);
  return x;
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

/// The robust objective, its gradient and the weights of the least squares that bound it, from one
/// pass over the edges.
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

  const MeasurementGraph& graph() const { return *graph_; }
  const std::vector<double>& precision() const { return *precision_; }
  const RobustLoss& loss() const { return loss_; }
  int num_threads() const { return num_threads_; }

  /// Moves to other rotations, or another loss.
  void update(const Quaternions& q, const RobustLoss& loss) {
    loss_ = loss;
    update(q);
  }
  void update(const Quaternions& q) {
    const Index m = graph_->num_edges();
    objective_ = block_sum<double>((m + 3) / 4, num_threads_, [&, loss = loss_](Index four) {
      prefetch_ahead(graph_->quaternion_edges(), 4 * four);
      const Index last = m - 1, k = 4 * four;
      const Index edge[4] = {k, std::min(k + 1, last), std::min(k + 2, last),
                             std::min(k + 3, last)};
      Lanes e[4], precision, share, cost;
      residual_quaternions_of_four(*graph_, q, edge, e);
      for (int a = 0; a < 4; ++a) precision[a] = precision_of(*precision_, edge[a]);
      const Lanes v2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2], weight = v2 + e[3] * e[3];
      const Lanes x = 4.0 * v2 / weight;
      weight_shares(loss, x, precision, share);
      const Lanes s = share * e[3];
      for (int a = 0; a < 3; ++a) e[a] *= s;
      e[3] = share * weight;
      transpose(e);
      robust_costs(loss, x, precision, cost);
      double sum = 0.0;
      for (int a = 0; a < 4 && k + a < m; ++a) {
        std::memcpy(pull_[k + a].data(), &e[a], sizeof(Lanes));
        sum += weight[a] * cost[a];
      }
      return sum;
    });
    objective_ *= 2.0;
  }

  double objective() const { return objective_; }

  /// The gradient at node l in the global frame, R_l <- exp(w) R_l: of the weighted problem, and so
  /// of the robust one.
  Vector3 gradient(Index l) const {
    const Vector4 sum = pull_on(l);
    return {8.0 * sum.x(), 8.0 * sum.y(), 8.0 * sum.z()};
  }

  GradientNorm gradient_norm() const {
    const auto sums = block_sum<GradientSums>(graph_->num_nodes(), num_threads_, [&](Index l) {
      if (graph_->row(l).size() == 0) return GradientSums{};
      const Vector4 sum = pull_on(l);
      const double square = 64.0 * vector_square(sum);
      return GradientSums{square, std::sqrt(square) / sum.w()};
    });
    return {std::sqrt(sums.squares), sums.largest};
  }

  /// The weights (m,) of the least squares that bound the objective and touch it here.
  const std::vector<double>& weights() {
    weights_.resize(pull_.size());
    parallel_for(graph_->num_edges(), num_threads_,
                 [&](Index k) { weights_[k] = std::clamp(pull_[k].w(), min_weight, max_weight); });
    return weights_;
  }

 private:
  /// An eighth of the gradient at node l, and its degree.
  Vector4 pull_on(Index l) const {
    Vector4 sum(0.0, 0.0, 0.0, 0.0);
    for (const HalfEdge& h : graph_->row(l)) {
      const Vector4& pull = pull_[h.edge()];
      const double sign = h.is_i() ? 1.0 : -1.0;
      for (int k = 0; k < 3; ++k) sum(k) += sign * pull(k);
      sum(3) += pull(3);
    }
    return sum;
  }

  const MeasurementGraph* graph_;
  const std::vector<double>* precision_;
  int num_threads_;
  LargeVector<Vector4> pull_;  ///< (m,) an eighth of the gradient at i, and the weight
  RobustLoss loss_;
  double objective_ = 0.0;
  std::vector<double> weights_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

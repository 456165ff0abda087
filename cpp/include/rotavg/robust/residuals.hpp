#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/so3/quaternion.hpp>

namespace rotavg {

/// The share of every weight that no robust loss takes away: an edge that it distrusts altogether
/// keeps this much, so that a graph stays connected and the weighted problem well posed.
constexpr double least_weight_share = 1e-6;

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
inline double robust_objective(const std::vector<double>& weights, const std::vector<double>& x,
                               const RobustLoss& loss, int num_threads) {
  return block_sum<double>(static_cast<Index>(x.size()), num_threads, [&](Index k) {
    const double rho = (1.0 - least_weight_share) * loss.rho(x[k]) + least_weight_share * x[k];
    return 2.0 * weights[k] * rho;
  });
}

/// The weights w ((1 - s) d rho / d x + s) of the least squares that bound this objective.
inline void robust_weights(const std::vector<double>& weights, const std::vector<double>& x,
                           const RobustLoss& loss, int num_threads, std::vector<double>& result) {
  result.resize(x.size());
  parallel_for(static_cast<Index>(x.size()), num_threads, [&](Index k) {
    const double share = (1.0 - least_weight_share) * loss.weight(x[k]) + least_weight_share;
    result[k] = std::max(min_weight, weights[k] * share);
  });
}

inline std::vector<double> weights_of(const MeasurementGraph& graph) {
  std::vector<double> weights;
  weights.reserve(graph.edges().size());
  for (const Edge& e : graph.edges()) weights.push_back(e.weight);
  return weights;
}

}  // namespace rotavg

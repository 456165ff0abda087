#pragma once

#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// A few steps of any solver of the weighted least squares (3), in place; the objective must not
/// rise.
using InnerSteps = std::function<void(const MeasurementGraph&, Quaternions&, const Monitor&)>;

/// Iteratively reweighted least squares (Holland and Welsch 1977; for rotations Chatterjee and
/// Govindu 2018). Each iteration gives every edge the weight that bounds the robust objective from
/// above, takes some inner steps on the weighted problem from where the last ones ended, and so
/// never lets the robust objective rise. The progress reports that objective, and the gradient of
/// the weighted problem, which is that of the robust one. Losses with a sharp bend let the gradient
/// fall slowly, long after nothing is left to gain; so the objective decides when to stop.
///
/// @param graph its weights are changed; they end as those of the returned rotations
/// @param weights (m,) given weights of the edges
/// @param R the initial value, world_from_i, one rotation per node
/// @param least_gain stop where an iteration lowers the objective by a smaller part of it; the
///        status is then step_converged
inline IterationResult irls(MeasurementGraph& graph, const std::vector<double>& weights,
                            const Rotations& R, const RobustLoss& loss, const InnerSteps& inner,
                            double least_gain, const IterationOptions& options) {
  Monitor monitor(graph, R, options);
  const int num_threads = monitor.num_threads();
  Quaternions q = to_quaternions(R);
  ResidualQuaternions residuals(graph, q, num_threads);
  std::vector<double> x, reweighted;
  double last = std::numeric_limits<double>::infinity();
  bool gains = true;
  for (;;) {
    squared_residuals(residuals, x);
    robust_weights(weights, x, loss, num_threads, reweighted);
    graph.set_weights(reweighted);
    residuals.update(q);
    const double objective = robust_objective(weights, x, loss, num_threads);
    if (monitor.should_stop(objective, residuals.gradient_norm(), 0.0)) break;
    gains = last - objective > least_gain * objective;
    last = objective;
    if (!gains) break;
    inner(graph, q, monitor);
    residuals.update(q);
  }
  IterationResult result = std::move(monitor).result(to_rotations(q, R));
  if (!gains) result.status = Status::step_converged;
  return result;
}

}  // namespace rotavg

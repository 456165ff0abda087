#pragma once

#include <limits>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// Reweightings until the monitor ends them, or one gains less than a part of the objective.
/// @param residuals at q, before and after
/// @returns whether all have gained enough
inline bool reweight(RobustResiduals& residuals, Quaternions& q, const InnerSteps& inner,
                     double least_gain, Monitor& monitor) {
  double last = std::numeric_limits<double>::infinity();
  while (!monitor.should_stop(residuals.objective(), residuals.gradient_norm(), 0.0)) {
    const double objective = residuals.objective();
    if (!(last - objective > least_gain * objective)) return false;
    last = objective;
    inner(residuals, q, monitor);
  }
  return true;
}

/// Iteratively reweighted least squares (Holland and Welsch 1977; for rotations Chatterjee and
/// Govindu 2018). Edges get the weights that bound the robust objective from above, and steps on
/// that weighted problem, from where the last ones ended, never let the robust objective rise. The
/// progress reports that objective, and its gradient. Losses with a sharp bend let the gradient
/// fall slowly, long after nothing is left to gain; so the objective decides when to stop.
///
/// @param graph with the given weights
/// @param R the initial value, world_from_i, one rotation per node
/// @param precision (m,) in whose units the residuals are judged; empty: all 1
/// @param least_gain stop where an iteration lowers the objective by a smaller part of it; the
///        status is then step_converged
inline IterationResult irls(const MeasurementGraph& graph, const Rotations& R,
                            const RobustLoss& loss, const std::vector<double>& precision,
                            const InnerSteps& inner, double least_gain,
                            const IterationOptions& options) {
  Monitor monitor(graph, R, options);
  Quaternions q = to_quaternions(R);
  RobustResiduals residuals(graph, precision, monitor.num_threads());
  residuals.update(q, loss);
  const bool gains = reweight(residuals, q, inner, least_gain, monitor);
  IterationResult result = std::move(monitor).result(to_rotations(q, R));
  if (!gains) result.status = Status::step_converged;
  return result;
}

}  // namespace rotavg

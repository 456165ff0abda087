#pragma once

#include <utility>
#include <vector>

#include <rotavg/anisotropic/bcd.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/hessian.hpp>
#include <rotavg/anisotropic/metrics.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// Newton's method on general blocks, as solve/newton.hpp. The metric is factored at the start;
/// where it is not positive definite there, coordinate descent goes on instead.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
/// @param kind of the metric
inline IterationResult newton(const AnisotropicGraph& graph, const Rotations& R,
                              std::vector<Elimination>& eliminations, MetricKind kind,
                              const IterationOptions& options = {}) {
  Monitor monitor(graph.scalar(), R, options);
  Quaternions q = to_quaternions(R);
  AnisotropicResiduals residuals(graph, q, monitor.num_threads());
  const auto keep_going = [&] { return monitor.keep_going(); };
  const auto iterate = [&](auto& metric, CholeskyOutcome outcome) {
    if (outcome == CholeskyOutcome::not_positive_definite) {
      IterationOptions rest = options;
      rest.time_limit = std::max(0.0, rest.time_limit - monitor.seconds());
      return bcd(graph, R, rest);
    }
    if (outcome == CholeskyOutcome::stopped) {
      monitor.should_stop(residuals.objective(), residuals.gradient_norm(), 0.0);
      return std::move(monitor).result(R);
    }
    return newton_iteration(graph, R, std::move(q), residuals, metric, std::move(monitor));
  };
  switch (kind) {
    case MetricKind::scalar: {
      LaplacianMetric metric(graph.scalar(), eliminations);
      return iterate(metric, metric.factorize(keep_going));
    }
    case MetricKind::blocks: {
      BlockMetric metric(eliminations);
      return iterate(metric, metric.factorize(residuals, keep_going));
    }
    case MetricKind::diagonal:
      break;
  }
  DiagonalMetric metric(residuals);
  return iterate(metric, CholeskyOutcome::positive_definite);
}

/// The same in the metric that is predicted to take least.
inline IterationResult newton(const AnisotropicGraph& graph, const Rotations& R,
                              std::vector<Elimination>& eliminations,
                              const IterationOptions& options = {}) {
  return newton(graph, R, eliminations, metric_kind(graph, eliminations), options);
}

}  // namespace rotavg

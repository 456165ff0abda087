#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/flat.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/truncated_cg.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The iteration of Newton's method, R_i <- exp(w_i) R_i, from the residuals at q: conjugate
/// gradients in a metric, and a line search that lets the objective fall at every step (Armijo).
/// The measurements may have one weight each or full covariances:
///
///     Residuals   objective(), objective_rounding(), gradient(i), gradient_norm(), update(q)
///     functions   apply_hessian(residuals, p, Hp), bcd_sweep(graph, q, monitor)
///     Metric      apply(r, z)
///
/// @param R the initial value, which a node keeps that does not move
/// @param max_cg_steps of conjugate gradients: in a metric in which f is nearly round few do
template <typename Graph, typename Residuals, typename Metric>
IterationResult newton_iteration(const Graph& graph, const Rotations& R, Quaternions q,
                                 Residuals& residuals, Metric& metric, Monitor monitor,
                                 int max_cg_steps = 50) {
  constexpr int max_halvings = 40;
  constexpr double sufficient = 1e-4;
  const int num_threads = monitor.num_threads();
  Quaternions next(q);
  NodeVectors g(graph.num_nodes(), 3);
  TruncatedCg<NodeVectors> newton_direction;
  double step = 0.0;
  while (!monitor.should_stop(residuals.objective(), residuals.gradient_norm(), step)) {
    parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
      const Vector3 g_i = residuals.gradient(i);
      for (int k = 0; k < 3; ++k) g(i, k) = g_i(k);
    });
    const double forcing = std::min(0.1, std::sqrt(monitor.relative_gradient()));
    const NodeVectors& w = newton_direction(
        g, forcing, max_cg_steps, num_threads,
        [&](const NodeVectors& p, NodeVectors& Hp) { apply_hessian(residuals, p, Hp); },
        [&](const NodeVectors& r, NodeVectors& z) { metric.apply(r, z); },
        [&] { return monitor.keep_going(); });
    const double slope = flat_dot(g, w), f = residuals.objective();
    const double rounding = residuals.objective_rounding();

    double t = 1.0;
    for (int k = 0;; ++k, t *= 0.5) {
      if (k == max_halvings) {  // rounding, or no direction of descent: a sweep never rises
        next = q;
        bcd_sweep(graph, next, monitor);
        residuals.update(next);
        break;
      }
      parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
        next[i] = q[i];
        if (graph.row(i).size() > 0) next[i] = turned(q[i], t * row_of(w, i));
      });
      residuals.update(next);
      const double enough = f + sufficient * t * slope + rounding;
      if (residuals.objective() <= enough) break;
    }
    step = t * std::sqrt(2.0 / 3.0 * flat_dot(w, w) / graph.num_nodes());
    std::swap(q, next);
  }
  return std::move(monitor).result(to_rotations(q, R));
}

/// Newton's method on the product of rotations, preconditioned by the scalar graph Laplacian. On
/// trajectories it needs some tens of Laplacian solves where coordinate descent needs thousands of
/// sweeps.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param metric of this graph; factorised here
inline IterationResult newton(const MeasurementGraph& graph, const Rotations& R,
                              LaplacianMetric& metric, const IterationOptions& options = {}) {
  Monitor monitor(graph, R, options);
  // Weights so far apart that L is singular to rounding leave no metric to descend in.
  const auto outcome = metric.factorize([&] { return monitor.keep_going(); });
  if (outcome == CholeskyOutcome::not_positive_definite) {
    IterationOptions rest = options;
    rest.time_limit = std::max(0.0, rest.time_limit - monitor.seconds());
    return bcd(graph, R, rest);
  }
  Quaternions q = to_quaternions(R);
  ResidualQuaternions residuals(graph, q, monitor.num_threads());
  if (outcome == CholeskyOutcome::stopped) {
    monitor.should_stop(residuals.objective(), residuals.gradient_norm(), 0.0);
    return std::move(monitor).result(R);
  }
  return newton_iteration(graph, R, std::move(q), residuals, metric, std::move(monitor));
}

/// The same with a metric of its own.
inline IterationResult newton(const MeasurementGraph& graph, const Rotations& R,
                              const IterationOptions& options = {}) {
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations =
      grounded_eliminations(graph, components, resolve_num_threads(options.num_threads));
  LaplacianMetric metric(graph, eliminations);
  return newton(graph, R, metric, options);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

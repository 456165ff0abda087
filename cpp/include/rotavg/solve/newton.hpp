#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

namespace detail {

/// An approximate solution w of H w = -g by conjugate gradients with the preconditioner P (Steihaug
/// 1983 without a radius): stops at |r|_P <= forcing |g|_P, and where the curvature is not
/// positive. The first step alone is the Laplacian descent direction.
inline NodeVectors newton_direction(const Hessian& H, LaplacianMetric& P, const NodeVectors& g,
                                    double forcing, int max_steps) {
  NodeVectors w = NodeVectors::Zero(g.rows(), 3);
  NodeVectors r = g;  // H w + g
  NodeVectors z = P.apply(r);
  NodeVectors p = -z;
  double rz = r.cwiseProduct(z).sum();
  const double enough = forcing * forcing * rz;
  for (int k = 0; k < max_steps; ++k) {
    const NodeVectors Hp = H.apply(p);
    const double curvature = p.cwiseProduct(Hp).sum();
    if (!(curvature > 0.0)) return k == 0 ? p : w;
    const double alpha = rz / curvature;
    w += alpha * p;
    r += alpha * Hp;
    z = P.apply(r);
    const double rz_next = r.cwiseProduct(z).sum();
    if (!(rz_next > enough)) break;
    p = (rz_next / rz) * p - z;
    rz = rz_next;
  }
  return w;
}

}  // namespace detail

/// Newton's method on the product of rotations, R_i <- exp(w_i) R_i, with conjugate gradients
/// preconditioned by the scalar graph Laplacian, and a line search that lets the objective fall at
/// every step (Armijo). On trajectories it needs some tens of Laplacian solves where coordinate
/// descent needs thousands of sweeps.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param metric of this graph; factorised here
inline IterationResult newton(const MeasurementGraph& graph, Rotations R, LaplacianMetric& metric,
                              const IterationOptions& options = {}) {
  constexpr int max_cg_steps = 50;
  constexpr int max_halvings = 40;
  constexpr double sufficient = 1e-4;
  Monitor monitor(graph, R, options);
  const int num_threads = monitor.num_threads();
  // Weights so far apart that L is singular to rounding leave no metric to descend in.
  const auto outcome = metric.factorize([&] { return monitor.keep_going(); });
  if (outcome == CholeskyOutcome::not_positive_definite) {
    return bcd(graph, std::move(R), options);
  }

  Rotations next(R.size());
  Hessian hessian(graph, R, num_threads);
  double f = objective(graph, R, num_threads), step = 0.0;
  while (!monitor.should_stop(R, f, step)) {
    NodeVectors g(graph.num_nodes(), 3);
    const std::vector<Vector3> gradients = gradient(graph, R, num_threads);
    for (Index i = 0; i < graph.num_nodes(); ++i) g.row(i) = gradients[i].transpose();
    hessian.update(R);
    const double forcing = std::min(0.1, std::sqrt(monitor.relative_gradient()));
    const NodeVectors w = detail::newton_direction(hessian, metric, g, forcing, max_cg_steps);
    const double slope = g.cwiseProduct(w).sum();

    double t = 1.0, f_next = f;
    for (int k = 0;; ++k, t *= 0.5) {
      parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
        next[i] = graph.row(i).size() == 0 ? R[i] : turned(R[i], t * w.row(i).transpose());
      });
      f_next = objective(graph, next, num_threads);
      if (f_next <= f + sufficient * t * slope + objective_rounding(graph, f)) break;
      if (k == max_halvings) {
        next = R;
        f_next = f;
        break;
      }
    }
    double change2 = 0.0;
    for (Index i = 0; i < graph.num_nodes(); ++i) change2 += (next[i] - R[i]).squaredNorm();
    step = std::sqrt(change2 / (3.0 * graph.num_nodes()));
    std::swap(R, next);
    f = f_next;
  }
  return std::move(monitor).result(std::move(R));
}

/// The same with a metric of its own.
inline IterationResult newton(const MeasurementGraph& graph, Rotations R,
                              const IterationOptions& options = {}) {
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  LaplacianMetric metric(graph, eliminations);
  return newton(graph, std::move(R), metric, options);
}

}  // namespace rotavg

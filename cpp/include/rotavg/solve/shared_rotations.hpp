#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/shared_riding.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/shared_metric.hpp>
#include <rotavg/solve/stopwatch.hpp>
#include <rotavg/solve/truncated_cg.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What refine_shared() ended with.
struct SharedResult {
  Rotations variables;  ///< Q
  Rotations shared;     ///< C
  /// Of every C, whether the edges tell it: the objective rises in all directions from it.
  std::vector<bool> determined;
  bool converged = false;
  int iterations = 0;
  double objective = 0.0;
  double relative_gradient = 0.0;  ///< largest |gradient| / degree, of variables and shared
};

namespace detail {

/// exp(w) Q K exp(c) = exp(w + d + w x d / 2 + ...) Q K with d = Q K c (Baker, Campbell,
/// Hausdorff): adds to Hp what the term of second order costs along the gradients g of the nodes,
/// g^T (w x d) / 2, which need not vanish where their sums do.
///
/// @param frame (n,) Q_v(i) K_i
/// @param gradients (n, 3) of the nodes
/// @param p, Hp (variables + shared, 3)
inline void add_commutators(const SharedRiding& problem, const Rotations& frame,
                            const NodeVectors& gradients, const NodeVectors& p, NodeVectors& Hp) {
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (problem.shared[i] < 0) continue;
    const Index v = problem.riding.variable[i],
                s = problem.riding.num_variables + problem.shared[i];
    const Vector3 w = p.row(v), d = frame[i] * p.row(s).transpose();
    const Matrix3 half_g = 0.5 * hat(row_of(gradients, static_cast<Index>(i)));
    Hp.row(v) -= (half_g * d).transpose();
    Hp.row(s) += (frame[i].transpose() * (half_g * w)).transpose();
  }
}

}  // namespace detail

/// Descends to a stationary point of f (3) in the variables and the shared rotations together, by
/// Newton's method with conjugate gradients: Q_v <- exp(w_v) Q_v, C_s <- exp(c_s) C_s. Hessian and
/// gradient are those of the nodes, w_i = w_v(i) + Q_v(i) K_i c_s(i) + ... The objective never
/// rises.
///
/// @param graph of the nodes
/// @param between the graph of the variables; its topology and weights are the metric
/// @param Q, C where it starts
/// @param max_iterations instead of those of the options, which are those of a solve
inline SharedResult refine_shared(const MeasurementGraph& graph, const SharedRiding& problem,
                                  const MeasurementGraph& between, Rotations Q, Rotations C,
                                  const IterationOptions& options = {}, int max_iterations = 100) {
  constexpr double max_flops = 1e10;
  constexpr int max_cg_steps = 50, max_halvings = 30;
  constexpr double sufficient = 1e-4;
  const Stopwatch watch;
  const Index V = problem.riding.num_variables, S = problem.num_shared, n = graph.num_nodes();
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());
  Eigen::VectorXd degrees = Eigen::VectorXd::Zero(V + S);
  for (Index i = 0; i < n; ++i) {
    degrees(problem.riding.variable[i]) += graph.degree(i);
    if (problem.shared[i] >= 0) degrees(V + problem.shared[i]) += graph.degree(i);
  }
  const auto keep_going = [&] {
    return watch.seconds() <= options.time_limit && (!options.keep_going || options.keep_going());
  };
  const Components components = connected_components(between);
  std::vector<Elimination> eliminations = grounded_eliminations(between, components, num_threads);
  LaplacianMetric laplacian(between, eliminations);
  const bool factored = laplacian.flops(max_flops) <= max_flops &&
                        laplacian.factorize(keep_going) == CholeskyOutcome::positive_definite;
  detail::SharedMetric metric(graph, problem, factored ? &laplacian : nullptr, degrees);

  SharedResult result;
  Rotations frame = problem.riding.nodes_from(Q);
  ResidualQuaternions residuals(graph, to_quaternions(problem.nodes_from(Q, C)), num_threads);
  NodeVectors gradients(n, 3), of_nodes(n, 3), H_w(n, 3), g;
  TruncatedCg<NodeVectors> newton_direction;
  for (;; ++result.iterations) {
    for (Index i = 0; i < n; ++i) gradients.row(i) = residuals.gradient(i).transpose();
    metric.gather(frame, gradients, g);
    result.relative_gradient = 0.0;
    for (Index k = 0; k < V + S; ++k) {
      if (degrees(k) == 0.0) continue;
      result.relative_gradient = std::max(result.relative_gradient, g.row(k).norm() / degrees(k));
    }
    metric.update(frame);
    result.converged = result.relative_gradient <= options.tolerance;
    if (result.converged || result.iterations == max_iterations || !keep_going()) break;
    const double forcing = std::min(0.1, std::sqrt(result.relative_gradient));
    const NodeVectors& w = newton_direction(
        g, forcing, max_cg_steps, num_threads,
        [&](const NodeVectors& p, NodeVectors& Hp) {
          metric.scatter(frame, p, of_nodes);
          apply_hessian(residuals, of_nodes, H_w);
          metric.gather(frame, H_w, Hp);
          detail::add_commutators(problem, frame, gradients, p, Hp);
        },
        [&](const NodeVectors& r, NodeVectors& z) { metric.apply(r, z); });
    const double f = residuals.objective();
    Rotations next_Q(Q), next_C(C);
    const double slope = g.cwiseProduct(w).sum();
    bool fell = false;
    double t = 1.0;
    for (int k = 0; k < max_halvings && !fell && slope < 0.0; ++k, t *= 0.5) {
      for (Index v = 0; v < V; ++v) next_Q[v] = exp_so3(t * w.row(v).transpose()) * Q[v];
      for (Index s = 0; s < S; ++s) next_C[s] = exp_so3(t * w.row(V + s).transpose()) * C[s];
      residuals.update(to_quaternions(problem.nodes_from(next_Q, next_C)));
      fell = residuals.objective() <= f + sufficient * t * slope + residuals.objective_rounding();
    }
    if (!fell) {
      residuals.update(to_quaternions(problem.nodes_from(Q, C)));
      break;
    }
    Q = std::move(next_Q);
    C = std::move(next_C);
    frame = problem.riding.nodes_from(Q);
  }
  for (Matrix3& R : Q) R = nearest_rotation(R);
  for (Matrix3& R : C) R = nearest_rotation(R);
  result.variables = std::move(Q);
  result.shared = std::move(C);
  result.determined = metric.determined();
  result.objective = residuals.objective();
  return result;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

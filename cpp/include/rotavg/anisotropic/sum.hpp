#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/linalg/lobpcg.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/sum.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A lower estimate of lambda_min(Rt) for general blocks, as min_eigenvalue_of_measurements().
inline double min_eigenvalue_of_measurements(const AnisotropicGraph& graph, int num_threads,
                                             const std::function<bool()>& keep_going = {},
                                             double relative_tolerance = 1e-4) {
  const Eigen::Index rows = 3 * static_cast<Eigen::Index>(graph.num_nodes());
  double bound = 0.0;  // no eigenvalue of M exceeds tr(H) / 2, three scalar weights
  for (Index i = 0; i < graph.num_nodes(); ++i) bound = std::max(bound, 3.0 * graph.degree(i));
  LobpcgOptions options;
  options.tolerance = relative_tolerance * bound;
  options.keep_going = keep_going;
  const LinearOperator apply = [&](const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(rows, X.cols());
    parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
      for (const HalfEdge& h : graph.row(i)) add_block_product(graph.block(h), X, h.node, Y, i);
    });
    return Y;
  };
  const Eigenpair pair =
      smallest_eigenpair(apply, {}, random_start(rows, 4), Eigen::MatrixXd(rows, 0), options);
  return std::max(pair.value - pair.residual, -bound);
}

/// Successive upper-bound minimisation (Algorithm 3) on general blocks, all nodes at once; see
/// solve/sum.hpp. B = diag(mu_i) + Rt >= 0 holds for mu_i = 3 deg_i, deg the scalar degree, and
/// MuRule::adaptive raises theta in mu_i = 3 theta deg_i up to that.
///
/// @param R the initial value, world_from_i, one rotation per node
inline IterationResult sum(const AnisotropicGraph& graph, Rotations R,
                           const IterationOptions& options = {},
                           MuRule mu_rule = MuRule::adaptive) {
  Monitor monitor(graph.scalar(), R, options);
  const int num_threads = monitor.num_threads();
  const bool adaptive = mu_rule == MuRule::adaptive;
  double mu = 0.0, theta = 0.0;
  if (!adaptive) {
    mu = -std::min(0.0, min_eigenvalue_of_measurements(graph, num_threads,
                                                       [&] { return monitor.keep_going(); }));
  }
  AnisotropicResiduals residuals(graph, to_quaternions(R), num_threads);
  Rotations next = R;
  double step = 0.0;
  while (!monitor.should_stop(residuals.objective(), residuals.gradient_norm(), step)) {
    const double f = residuals.objective(), rounding = residuals.objective_rounding();
    for (;;) {
      const auto sums = block_sum<detail::StepSums>(graph.num_nodes(), num_threads, [&](Index i) {
        if (graph.row(i).size() == 0) return detail::StepSums{};
        const double mu_i = mu + 3.0 * theta * graph.degree(i);
        const Matrix3 A_i = linear_cost(graph, R, i) - mu_i * R[i].transpose();  // (23)
        next[i] = loso_fast(A_i);                                                // (24)
        const Matrix3 change = next[i] - R[i];
        return detail::StepSums{-2.0 * (A_i * change).trace(), change.squaredNorm()};
      });
      residuals.update(to_quaternions(next));
      step = std::sqrt(sums.change / (3.0 * graph.num_nodes()));
      const double enough = f - 0.25 * sums.promise + rounding + residuals.objective_rounding();
      if (residuals.objective() <= enough || !adaptive || theta >= 1.0) break;
      theta = std::max(0.125, 2.0 * theta);
    }
    std::swap(R, next);
  }
  return std::move(monitor).result(std::move(R));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

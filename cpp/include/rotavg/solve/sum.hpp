#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// Successive upper-bound minimisation (Algorithm 3). Where B = mu I + Rt >= 0, the objective (20)
/// is bounded above by a function that is linear in R and touches it at the current value (Lemma 2,
/// (21)); its minimum over all blocks at once, [A_1 … A_n] = -R B (22), (23), is n independent
/// LOSO problems (24). The blocks are spread over threads; the result does not depend on how many.
///
/// mu may differ between the nodes: B >= 0 holds for mu_i = deg_i, and descent often for much less.
/// MuRule::adaptive starts at mu = 0. With B >= 0 a step lowers f at least by what its linear part
/// promises; where a step gains less than a quarter of that (or nothing, as undamped steps on a
/// bipartite graph, which swing between two values), it is taken back and theta is raised in
/// mu_i = theta deg_i, at most to 1. Either way the objective never rises.
///
/// @param R the initial value, world_from_i, one rotation per node
inline IterationResult sum(const MeasurementGraph& graph, Rotations R,
                           const IterationOptions& options = {},
                           MuRule mu_rule = MuRule::adaptive) {
  Monitor monitor(graph, R, options);
  const int num_threads = monitor.num_threads();
  double theta = 0.0, mu = 0.0;
  if (mu_rule == MuRule::min_eigenvalue) {
    const auto keep_going = [&] { return monitor.keep_going(); };
    mu = -std::min(0.0, min_eigenvalue_of_measurements(graph, num_threads, keep_going));
  }

  Rotations next(R.size());
  std::vector<double> promise(R.size());
  const auto sum_over_nodes = [&](auto&& term) {
    return block_sum<double>(graph.num_nodes(), num_threads, term);
  };
  double f = objective(graph, R, num_threads), step = 0.0;
  while (!monitor.should_stop(R, f, step)) {
    double f_next = 0.0;
    for (;;) {
      parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
        const double mu_i = mu + theta * graph.degree(i);
        const Matrix3 A_i = linear_cost(graph, R, i) - mu_i * R[i].transpose();  // (23), transposed
        next[i] = graph.row(i).size() == 0 ? R[i] : loso_fast(A_i);              // (24)
        // tr A_i (R_i - X) at the minimiser X, where -A_i X is symmetric, without cancellation.
        const Matrix3 change = R[i] - next[i];
        promise[i] = -(change * (A_i * next[i])).cwiseProduct(change).sum();
      });
      f_next = objective(graph, next, num_threads);
      const double promised = sum_over_nodes([&](Index i) { return promise[i]; });
      const bool falls = f_next <= f - 0.25 * promised + objective_rounding(graph, f);
      if (falls || mu_rule != MuRule::adaptive || theta >= 1.0) break;
      theta = std::max(0.125, 2.0 * theta);
    }
    const double change2 = sum_over_nodes([&](Index i) { return (next[i] - R[i]).squaredNorm(); });
    step = std::sqrt(change2 / (3.0 * graph.num_nodes()));
    std::swap(R, next);
    f = f_next;
  }
  return std::move(monitor).result(std::move(R));
}

}  // namespace rotavg

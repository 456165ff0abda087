#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

namespace detail {

/// 4 (y^T K y - x^T K x) of unit vectors, without cancellation where they are close.
inline double gain(const Matrix4& K, const Vector4& x, const Vector4& y) {
  const Vector4 d = x.dot(y) < 0.0 ? Vector4(y + x) : Vector4(y - x);
  const double value = y.dot(K * y);
  return 4.0 * d.dot(value * (d - 2.0 * y) - K * (d - 2.0 * y));
}

/// What the step of a node promises to gain, and |R - R'|_F^2.
struct StepSums {
  double promise = 0.0;
  double change = 0.0;
  StepSums& operator+=(const StepSums& other) {
    promise += other.promise;
    change += other.change;
    return *this;
  }
};

}  // namespace detail

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
inline IterationResult sum(const MeasurementGraph& graph, const Rotations& R,
                           const IterationOptions& options = {},
                           MuRule mu_rule = MuRule::adaptive) {
  Monitor monitor(graph, R, options);
  const int num_threads = monitor.num_threads();
  double theta = 0.0, mu = 0.0;
  if (mu_rule == MuRule::min_eigenvalue) {
    const auto keep_going = [&] { return monitor.keep_going(); };
    mu = -std::min(0.0, min_eigenvalue_of_measurements(graph, num_threads, keep_going));
  }

  Quaternions q = to_quaternions(R), next(q);
  DavenportMatrices now, then;
  now.update(graph, q, num_threads);
  double step = 0.0;
  while (!monitor.should_stop(now.objective, now.gradient, step)) {
    for (;;) {
      const auto sums = block_sum<detail::StepSums>(graph.num_nodes(), num_threads, [&](Index i) {
        if (graph.row(i).size() == 0) return detail::StepSums{};
        const Vector4 q_i = q[i].coeffs();
        const double mu_i = mu + theta * graph.degree(i);
        const Matrix4 K_i = now.K[i] + mu_i * q_i * q_i.transpose();  // (23)
        next[i] = loso(K_i, q[i]);                                    // (24)
        return detail::StepSums{detail::gain(K_i, q_i, next[i].coeffs()),
                                std::pow(chordal_distance(q[i], next[i]), 2)};
      });
      then.update(graph, next, num_threads);
      step = std::sqrt(sums.change / (3.0 * graph.num_nodes()));
      const double rounding = now.objective_rounding + then.objective_rounding;
      const bool falls = then.objective <= now.objective - 0.25 * sums.promise + rounding;
      if (falls || mu_rule != MuRule::adaptive || theta >= 1.0) break;
      theta = std::max(0.125, 2.0 * theta);
    }
    std::swap(q, next);
    std::swap(now, then);
  }
  return std::move(monitor).result(to_rotations(q));
}

}  // namespace rotavg

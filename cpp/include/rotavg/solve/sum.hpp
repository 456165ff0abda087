#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/loso_quaternion.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// 4 (y^T K y - x^T K x) of unit vectors, without cancellation where they are close.
inline double gain(const Matrix4& K, const Vector4& x, const Vector4& y) {
  const Vector4 d = x.dot(y) < 0.0 ? Vector4(y + x) : Vector4(y - x);
  const Vector4 Ky = K * y;
  Vector4 opposite = d;  // -(x + y), or its like
  opposite -= 2.0 * y;
  const Vector4 K_opposite = K * opposite;
  return 4.0 * (y.dot(Ky) * d.dot(opposite) - d.dot(K_opposite));
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

/// Small differences of large sums are good enough to iterate by, and stay in the trace. What is
/// returned is summed edge by edge.
inline IterationResult restated(const MeasurementGraph& graph, IterationResult result,
                                int num_threads) {
  result.objective = objective(graph, to_quaternions(result.rotations), num_threads);
  return result;
}

}  // namespace detail

/// One step of successive upper-bound minimisation, and the mu that it has arrived at.
class SumStep {
 public:
  /// Computes lambda_min(Rt) where the rule needs it.
  /// @param graph must outlive this object
  SumStep(const MeasurementGraph& graph, MuRule mu_rule, const Monitor& monitor)
      : graph_(graph), adaptive_(mu_rule == MuRule::adaptive), num_threads_(monitor.num_threads()) {
    if (adaptive_) return;
    const auto keep_going = [&monitor] { return monitor.keep_going(); };
    mu_ = -std::min(0.0, min_eigenvalue_of_measurements(graph, num_threads_, keep_going));
  }

  /// Steps from q to `next`.
  /// @param at, after what is known at q, and, on return, at `next`; there the objective is not
  ///        higher but for rounding
  /// @returns the paper's measure of the step, |R - R'| / |R|
  double operator()(const Quaternions& q, const DavenportMatrices& at, Quaternions& next,
                    DavenportMatrices& after) {
    for (;;) {
      const auto sums = block_sum<detail::StepSums>(graph_.num_nodes(), num_threads_, [&](Index i) {
        if (graph_.row(i).size() == 0) return detail::StepSums{};
        const Vector4 q_i = q[i].coeffs();
        const double mu_i = mu_ + theta_ * graph_.degree(i);
        Matrix4 K_i = at[i];  // (23)
        for (int c = 0; c < 4; ++c) {
          for (int r = 0; r < 4; ++r) K_i(r, c) += (mu_i * q_i(r)) * q_i(c);
        }
        next[i] = loso(K_i, q[i]);  // (24)
        return detail::StepSums{detail::gain(K_i, q_i, next[i].coeffs()),
                                std::pow(chordal_distance(q[i], next[i]), 2)};
      });
      after.update(next);
      const double rounding = at.objective_rounding() + after.objective_rounding();
      const bool falls = after.objective() <= at.objective() - 0.25 * sums.promise + rounding;
      if (falls || !adaptive_ || theta_ >= 1.0) {
        return std::sqrt(sums.change / (3.0 * graph_.num_nodes()));
      }
      theta_ = std::max(0.125, 2.0 * theta_);
    }
  }

 private:
  const MeasurementGraph& graph_;
  bool adaptive_;
  int num_threads_;
  double theta_ = 0.0, mu_ = 0.0;
};

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
  SumStep take_step(graph, mu_rule, monitor);
  Quaternions q = to_quaternions(R), next(q);
  DavenportMatrices at(graph, q, monitor.num_threads()), after(at);
  double step = 0.0;
  while (!monitor.should_stop(at.objective(), at.gradient_norm(), step)) {
    step = take_step(q, at, next, after);
    std::swap(q, next);
    std::swap(at, after);
  }
  const int num_threads = monitor.num_threads();
  return detail::restated(graph, std::move(monitor).result(to_rotations(q, R)), num_threads);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

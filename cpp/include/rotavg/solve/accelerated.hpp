#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include <rotavg/graph/coloring.hpp>
#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/anderson.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/sum.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A descent method made faster by Anderson's mixing. Each iteration takes one plain step, and goes
/// on to what the mixing predicts if the objective is not higher there. So it gains at least what a
/// plain step from the same place does, for the price of one more evaluation and some vector
/// operations.
///
/// @tparam Evaluation ResidualQuaternions or DavenportMatrices: what is known at some rotations
/// @param monitor has not been told anything yet; its result is returned
/// @param step `step(q, at, next, after)`: one plain step from q to `next`, where the objective is
///        not higher but for rounding; `after` receives the evaluation there
/// @param measure `double measure(q, next)`: the paper's measure of an iteration
template <typename Evaluation, typename Step, typename Measure>
IterationResult accelerate(const MeasurementGraph& graph, const Rotations& R, Monitor& monitor,
                           Step&& step, Measure&& measure) {
  AndersonMixing anderson(graph, monitor.num_threads());
  Quaternions q = to_quaternions(R), next(q), mixed(q);
  Evaluation at(graph, q, monitor.num_threads()), after(at), at_mixed(at);
  double size = 0.0, lowest = at.objective();
  while (!monitor.should_stop(at.objective(), at.gradient_norm(), size)) {
    step(q, at, next, after);
    lowest = std::min(lowest, after.objective());
    if (anderson.mix(q, next, mixed)) {
      at_mixed.update(mixed);
      // Against the lowest value so far, so that rounding does not pile up.
      if (at_mixed.objective() <= lowest + at_mixed.objective_rounding()) {
        std::swap(next, mixed);
        std::swap(after, at_mixed);
        lowest = std::min(lowest, after.objective());
      }
    }
    size = measure(q, next);
    std::swap(q, next);
    std::swap(at, after);
  }
  return std::move(monitor).result(to_rotations(q, R));
}

/// Block coordinate descent (Algorithm 2), accelerated. An iteration is two sweeps, to and fro:
/// that makes the step self-adjoint near a solution, and the mixing gains more from it than from
/// twice as many sweeps in one direction.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param coloring of the nodes, in whose order sweeps go; by default they go in that of the nodes
inline IterationResult accelerated_bcd(const MeasurementGraph& graph, const Rotations& R,
                                       const IterationOptions& options = {},
                                       const Coloring* coloring = nullptr) {
  Monitor monitor(graph, R, options);
  const HalfEdgeRows rows(graph, coloring ? &coloring->node : nullptr, monitor.num_threads());
  const auto step = [&](const Quaternions& from, const ResidualQuaternions&, Quaternions& next,
                        ResidualQuaternions& after) {
    next = from;
    for (const SweepOrder order : {SweepOrder::rising, SweepOrder::falling}) {
      if (coloring) {
        bcd_sweep(rows, *coloring, next, monitor, order);
      } else {
        bcd_sweep(rows, next, monitor, order);
      }
    }
    after.update(next);
  };
  const auto measure = [](const Quaternions& from, const Quaternions& to) {
    double sum = 0.0;
    for (std::size_t l = 0; l < from.size(); ++l) {
      sum += chordal_distance(from[l], to[l]) / std::sqrt(3.0);
    }
    return sum;
  };
  return accelerate<ResidualQuaternions>(graph, R, monitor, step, measure);
}

/// Successive upper-bound minimisation (Algorithm 3), accelerated.
///
/// @param R the initial value, world_from_i, one rotation per node
inline IterationResult accelerated_sum(const MeasurementGraph& graph, const Rotations& R,
                                       const IterationOptions& options = {},
                                       MuRule mu_rule = MuRule::adaptive) {
  Monitor monitor(graph, R, options);
  const auto measure = [&](const Quaternions& from, const Quaternions& to) {
    const double change2 =
        block_sum<double>(graph.num_nodes(), monitor.num_threads(),
                          [&](Index i) { return std::pow(chordal_distance(from[i], to[i]), 2); });
    return std::sqrt(change2 / (3.0 * graph.num_nodes()));
  };
  SumStep step(graph, mu_rule, monitor);
  const int num_threads = monitor.num_threads();
  return detail::restated(graph, accelerate<DavenportMatrices>(graph, R, monitor, step, measure),
                          num_threads);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

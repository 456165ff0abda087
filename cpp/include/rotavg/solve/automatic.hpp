#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/coloring.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/accelerated.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/stopwatch.hpp>
#include <rotavg/solve/sum.hpp>

namespace rotavg {

/// Appends what a second solver did, which started where the first one ended.
inline void append(IterationResult& first, IterationResult second) {
  for (std::size_t k = 1; k < second.trace.size(); ++k) {
    Progress progress = second.trace[k];
    progress.iteration += first.iterations;
    progress.seconds += first.seconds;
    first.trace.push_back(progress);
  }
  second.iterations += first.iterations;
  second.seconds += first.seconds;
  second.trace = std::move(first.trace);
  first = std::move(second);
}

/// What is left of the limits for a second solver, whose reports continue those of the first.
inline IterationOptions remaining(const IterationOptions& options, const IterationResult& first) {
  IterationOptions rest = options;
  rest.time_limit = std::max(0.0, rest.time_limit - first.seconds);
  rest.max_iterations = std::max(0, rest.max_iterations - first.iterations);
  if (options.callback) {
    rest.callback = [callback = options.callback, iterations = first.iterations,
                     seconds = first.seconds](Progress progress) {
      if (progress.iteration == 0) return true;  // reported already
      progress.iteration += iterations;
      progress.seconds += seconds;
      return callback(progress);
    };
  }
  return rest;
}

/// A graph fills in where the factor of its Laplacian takes longer than so many sweeps.
constexpr double filled_sweeps = 7.0;

/// Operations of a factorisation that take as long as so many sweeps.
inline double flops_of_sweeps(const MeasurementGraph& graph, double sweeps) {
  constexpr double flops_an_end = 220.0;  // of an edge
  return sweeps * flops_an_end * 2.0 * graph.num_edges();
}

/// Where solve_automatically() starts.
enum class StartsFrom {
  initial_value,  ///< the gradient is small on average at any tree's start, which meets most edges
                  ///< exactly
  smoothed,       ///< sweeps have been made already
  given,          ///< the caller's rotations: no sweeps are needed where the gradient is small
  newton,         ///< where Newton's method has ended, and is to go on
};

/// A second start, made only if it is asked for.
struct OtherStart {
  std::function<std::optional<Rotations>()> make;  ///< may have nothing to offer
  bool is_used = false;
};

/// Sweeps, and Newton's method where they are slow:
///
/// - Sweeps come first: they smooth the start, from which Newton's method would run into bad local
///   minima more often, and converge later. (On grids and trajectories with noise of 0.1 to 0.3
///   rad, three did as well as twenty.)
/// - A start from coarser graphs has had its sweeps: where it is near, and the Laplacian factors in
///   the time of some sweeps, Newton's method goes on at once.
/// - On sparse graphs the Laplacian factors at little cost, unless it fills in, and Newton's method
///   goes on after three. From a given start that is near the optimum, as the last solution is when
///   some edges have come or gone, it needs none: they would only delay it.
/// - Where Newton's method wanders, it is far from any minimum or on its way to a bad one, and
///   starts anew elsewhere, if that is lower. (From the shortest paths the gradient falls below a
///   tenth in five steps on graphs of modest noise; where it did not, a sphere with noise of 0.3
///   rad took 82 steps to a local minimum, a city of 2e5 nodes 33 to the best one, and from the
///   chordal value 9 and 4.)
/// - On others the sweeps are watched; if at their rate many more would be needed, and these would
///   take longer than the Laplacian's factorisation is likely to, Newton's method takes over; where
///   the Laplacian is too large to factor, accelerated sweeps. On dense graphs, where all nodes at
///   once converge as quickly as one after the other, the sweeps are those of SUM, which reads the
///   measurements once for the step, the objective and the gradient. On those between they go by
///   colours, so that all threads are of use.
///
/// @param eliminations of all components, without their roots
/// @param from what the start is, which decides how many sweeps come first
/// @param method receives what was used in the end
/// @param reason receives one line on what was chosen and why
/// @param other another start, for where Newton's method wanders
inline IterationResult solve_automatically(const MeasurementGraph& graph,
                                           std::vector<Elimination>& eliminations,
                                           const Rotations& R, const IterationOptions& options,
                                           StartsFrom from, Method& method, std::string& reason,
                                           OtherStart* other = nullptr) {
  constexpr double dense_degree = 64.0, dense_share = 0.1;  // of all pairs of nodes
  constexpr double max_flops = 1e10;
  constexpr int first_sweeps = 3, watched_sweeps = 6;
  constexpr double bearable_sweeps = 40.0;
  constexpr double near = 0.1;       // radians, the root of the mean of squares
  constexpr int straight_steps = 5;  // of Newton's method
  constexpr double wandering = 0.1;  // radians, the largest gradient after these
  const double n = std::max<Index>(graph.num_nodes(), 1), degree = 2.0 * graph.num_edges() / n;
  const auto likely_flops = [&] {  // of the Laplacian's factorisation
    double flops = 0.0;
    for (Elimination& elimination : eliminations) flops += elimination.likely_flops(1);
    return flops;
  };
  const bool filled =
      degree <= sparse_degree && likely_flops() > flops_of_sweeps(graph, filled_sweeps);
  const bool sparse = degree <= sparse_degree && !filled;
  const bool dense = degree >= dense_degree && degree >= dense_share * n;
  const auto line = [&reason](const auto&... parts) {
    std::ostringstream text;
    text.precision(2);
    (text << ... << parts);
    reason = text.str();
  };

  // Of what comes after the sweeps: where there is no factor, sweeps again, which are accelerated.
  const auto are_too_many = [&](double sweeps) {
    if (sweeps <= bearable_sweeps) return false;
    const double flops = likely_flops();
    return flops > max_flops || flops_of_sweeps(graph, sweeps) > flops;
  };
  const auto is_near = [&](const Progress& start) {
    double squares = 0.0;
    for (Index l = 0; l < graph.num_nodes(); ++l) squares += graph.degree(l) * graph.degree(l);
    return start.gradient_norm <= near * std::sqrt(squares);
  };
  LaplacianMetric metric(graph, eliminations);
  const auto factors_soon = [&] {
    const double flops_left = flops_of_sweeps(graph, bearable_sweeps);
    return !dense && !filled && (sparse || metric.flops(flops_left) <= flops_left);
  };
  const bool needs_no_sweeps = from == StartsFrom::newton ||
                               (from == StartsFrom::given && sparse) ||
                               (from == StartsFrom::smoothed && factors_soon());
  const bool may_skip = needs_no_sweeps && options.max_iterations > 0 && options.time_limit > 0.0;

  // Sweeps, until they have converged or prove slow.
  method = dense ? Method::sum : Method::bcd;
  const char* const name = dense ? "sum" : "bcd";
  bool slow = false;
  double last = 0.0, before_last = 0.0;
  IterationOptions watched = options;
  watched.callback = [&](const Progress& progress) {
    if (options.callback && !options.callback(progress)) return false;
    const double rate =
        progress.iteration >= 2 ? std::sqrt(progress.relative_gradient / before_last) : 0.0;
    before_last = std::exchange(last, progress.relative_gradient);
    const bool skip = may_skip && progress.iteration == 0 && is_near(progress);
    if (!skip && progress.iteration < (sparse ? first_sweeps : watched_sweeps)) return true;
    const double sweeps = std::log(options.tolerance / last) / std::log(rate);
    slow = sparse || skip ||
           (options.stop == StopRule::gradient && !(rate < 1.0 && !are_too_many(sweeps)));
    return !slow;
  };
  std::optional<Coloring> coloring;
  if (!sparse && !dense && !may_skip) coloring = greedy_coloring(graph);
  IterationResult result =
      dense ? sum(graph, R, watched) : bcd(graph, R, watched, coloring ? &*coloring : nullptr);
  if (result.status != Status::stopped || !slow) {
    if (result.iterations == 0 && is_converged(result.status)) {
      line("the start was stationary");
    } else {
      line(name, ": average degree ", degree, ", ", filled ? "the Laplacian would fill in, " : "",
           result.iterations, " sweeps", is_converged(result.status) ? " did" : "");
    }
    return result;
  }
  const IterationOptions rest = remaining(options, result);
  const Rotations start = result.rotations;
  const double flops = metric.flops(max_flops);
  if (flops <= max_flops) {
    method = Method::newton;
    const std::string sweeps = std::to_string(result.iterations) + " sweeps of " + name;
    const std::string before = result.iterations > 0          ? "after " + sweeps
                               : from == StartsFrom::smoothed ? "from coarser graphs"
                                                              : "from a start that is near";
    line("newton ", before, ": average degree ", degree, ", the Laplacian factors in ", flops,
         " operations");
    bool wanders = false;
    IterationOptions watched_newton = rest;
    watched_newton.callback = [&](const Progress& progress) {
      if (rest.callback && !rest.callback(progress)) return false;
      wanders = other != nullptr && progress.iteration == straight_steps &&
                progress.relative_gradient > wandering;
      return !wanders;
    };
    append(result, newton(graph, start, metric, watched_newton));
    if (wanders && result.status == Status::stopped) {
      const Stopwatch watch;
      const std::optional<Rotations> there = other->make();
      result.seconds += watch.seconds();
      other->is_used = there && objective(graph, *there) < result.trace.back().objective;
      const IterationOptions more = remaining(options, result);
      if (other->is_used) {
        append(result, solve_automatically(graph, eliminations, *there, more,
                                           StartsFrom::initial_value, method, reason));
        reason = "newton wandered, and began anew: " + reason;
      } else {
        const Rotations here = result.rotations;
        append(result, newton(graph, here, metric, more));
      }
    }
  } else {
    method = Method::bcd;
    line("bcd, accelerated: the Laplacian is too large to factor (", flops, " operations)");
    // On lattices the order of the nodes takes a third fewer sweeps than two colours do.
    append(result, accelerated_bcd(graph, start, rest, coloring ? &*coloring : nullptr));
  }
  return result;
}

}  // namespace rotavg

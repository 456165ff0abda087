#pragma once

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/stopwatch.hpp>

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

/// Block coordinate descent, and Newton's method where sweeps are slow:
///
/// - Sweeps come first: they smooth the start, from which Newton's method would run into bad local
///   minima more often, and converge later. (On grids and trajectories with noise of 0.1 to 0.3 rad,
///   three did as well as twenty.)
/// - On sparse graphs the Laplacian factors at little cost, and Newton's method goes on after three.
/// - On others the sweeps are watched; if at their rate many more would be needed, Newton's method
///   takes over, unless the Laplacian is too large to factor.
///
/// @param method receives what was used in the end
/// @param reason receives one line on what was chosen and why
inline IterationResult solve_automatically(const MeasurementGraph& graph,
                                           std::vector<Elimination>& eliminations, const Rotations& R,
                                           const IterationOptions& options, Method& method,
                                           std::string& reason) {
  constexpr double sparse_degree = 20.0;  // edges at a node, on average
  constexpr double max_flops = 1e10;
  constexpr int first_sweeps = 3, watched_sweeps = 10;
  constexpr double patience = 40.0;  // sweeps
  const double degree = 2.0 * graph.num_edges() / std::max<Index>(graph.num_nodes(), 1);
  const auto line = [&reason](const auto&... parts) {
    std::ostringstream text;
    text.precision(2);
    (text << ... << parts);
    reason = text.str();
  };

  // Coordinate descent, until it has converged or proves slow.
  method = Method::bcd;
  bool slow = false;
  double last = 0.0, before_last = 0.0;
  IterationOptions watched = options;
  watched.callback = [&](const Progress& progress) {
    if (options.callback && !options.callback(progress)) return false;
    const double rate =
        progress.iteration >= 2 ? std::sqrt(progress.relative_gradient / before_last) : 0.0;
    before_last = std::exchange(last, progress.relative_gradient);
    const bool sparse = degree <= sparse_degree;
    if (progress.iteration < (sparse ? first_sweeps : watched_sweeps)) return true;
    const double sweeps = std::log(options.tolerance / last) / std::log(rate);
    slow = sparse || (options.stop == StopRule::gradient && !(rate < 1.0 && sweeps <= patience));
    return !slow;
  };
  IterationResult result = bcd(graph, R, watched);
  if (result.status != Status::stopped || !slow) {
    line("bcd: average degree ", degree, ", ", result.iterations, " sweeps did");
    return result;
  }
  IterationOptions rest = options;
  rest.time_limit -= result.seconds;
  rest.max_iterations -= result.iterations;
  if (options.callback) {
    rest.callback = [&, before = result.iterations, seconds = result.seconds](Progress progress) {
      if (progress.iteration == 0) return true;  // reported already
      progress.iteration += before;
      progress.seconds += seconds;
      return options.callback(progress);
    };
  }
  LaplacianMetric metric(graph, eliminations);
  const Rotations start = result.rotations;
  const double flops = metric.flops(max_flops);
  if (flops <= max_flops) {
    method = Method::newton;
    line("newton after ", result.iterations, " sweeps of bcd: average degree ", degree,
         ", the Laplacian factors in ", flops, " operations");
    append(result, newton(graph, start, metric, rest));
  } else {
    line("bcd: the Laplacian is too large to factor (", flops, " operations)");
    append(result, bcd(graph, start, rest));
  }
  return result;
}

}  // namespace rotavg

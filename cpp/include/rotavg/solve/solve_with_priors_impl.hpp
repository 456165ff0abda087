#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/alignment.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/solve/solve_impl.hpp>
#include <rotavg/solve/solve_with_priors.hpp>
#include <rotavg/solve/stop_request.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// What `solve` makes of the measurements alone, without what holds the world: between the frames
/// of rigs where there are some.
/// @param solve `Solution solve(const MeasurementGraph&, std::optional<Rotations> start)`, or of a
///        type derived from Solution
/// (Without a world they have the weights of the problem, with one the given weights.)
/// @returns its rotations and components are those of the given nodes
/// @throws std::invalid_argument if no edge joins two frames
template <typename Solve>
auto solve_measurements(const GroundedGraph& problem, std::optional<Rotations> start,
                        Solve&& solve) {
  const MeasurementGraph& given = problem.given();
  const bool has_rigs = !problem.priors().rigs.empty();
  if (!has_rigs) return solve(problem.has_world() ? given : problem.graph(), std::move(start));
  if (start) start = problem.frames().variables_from(checked_rotations(given, *std::move(start)));
  if (edges_between_variables(given, problem.frames()).empty()) {
    throw std::invalid_argument(
        "all edges are between cameras of one frame: none says how two frames lie to one another");
  }
  std::optional<ReducedGraph> between_frames;
  if (problem.has_world()) between_frames.emplace(given, problem.frames());
  auto solution =
      solve(between_frames ? between_frames->graph() : problem.graph(), std::move(start));
  solution.rotations = problem.frames().nodes_from(solution.rotations);
  solution.components = components_of_nodes(problem.frames(), solution.components);
  return solution;
}

/// Makes what was found for the variables what is told of the nodes.
/// @param Q of the variables
inline void tell_of_nodes(const GroundedGraph& problem, const Rotations& Q, Solution& solution) {
  solution.rotations = problem.nodes_from(headed(problem, Q));
  const double of_edges = solution.objective;  // with the constants of gravity
  solution.objective = objective(problem, solution.rotations);
  for (Progress& progress : solution.trace) progress.objective += solution.objective - of_edges;
  solution.components = components_of_nodes(problem.riding(), problem.components());
}

/// Turns what was found without the world to meet its priors, and goes on with them from there.
///
/// @param first of the given nodes, each component in a world of its own
/// @param watch that has been running since the call began: iterations and seconds go on counting
///        where `first` ended, and what it has left of the limits is what is left
inline Solution meet_priors(const GroundedGraph& problem, const Solution& first,
                            SolveOptions options, const Stopwatch& watch) {
  IterationOptions& limits = options.iteration;
  const bool stopped = first.status == Status::stopped;
  const double before = watch.seconds();
  limits.max_iterations = stopped ? 0 : std::max(0, limits.max_iterations - first.iterations);
  limits.time_limit = std::max(0.0, limits.time_limit - before);
  if (stopped) {
    limits.callback = nullptr;
  } else if (limits.callback) {
    double constant = 0.0;
    for (const Index k : problem.gravity().first) {
      constant += 8.0 * problem.graph().edges()[k].weight;
    }
    const bool told = first.status != Status::not_run;  // of the end of what came before
    limits.callback = [constant, told, before, iterations = first.iterations,
                       callback = std::move(limits.callback)](Progress progress) {
      if (progress.iteration == 0 && told) return true;
      progress.iteration += iterations;
      progress.seconds += before;
      progress.objective -= constant;
      return callback(progress);
    };
  }
  SolveRun run(problem.graph(), options, problem.gravity());
  const Rotations R = aligned_with_priors(problem, first.components.label, first.rotations);
  Solution solution = solve(run, problem.variables_from(R));
  if (stopped) solution.status = Status::stopped;
  tell_of_nodes(problem, solution.rotations, solution);
  solution.init = first.init;
  solution.iterations += first.iterations;
  solution.timings.init += first.timings.init;
  solution.timings.solve += first.timings.solve;
  if (first.status != Status::not_run) {
    const std::string then = solution.reason.empty() ? name_of(solution.method) : solution.reason;
    solution.reason = std::string("without priors ") + name_of(first.method) + ", then " + then;
  }
  return solution;
}

}  // namespace detail

ROTAVG_INLINE Solution solve(const GroundedGraph& problem, const SolveOptions& options,
                             std::optional<Rotations> start, bool start_is_solution) {
  if (!problem.has_world()) {
    Solution solution = detail::solve_measurements(
        problem, std::move(start), [&](const MeasurementGraph& graph, std::optional<Rotations> R) {
          return solve(graph, options, std::move(R));
        });
    solution.objective = objective(problem, solution.rotations);
    return solution;
  }
  check(options);
  const Stopwatch watch;
  const StopRequest stop;
  Solution first;
  if (start_is_solution && start) {
    first.rotations = checked_rotations(problem.given(), *std::move(start));
    first.components = components_without_world(problem);
  } else if (edges_between_variables(problem.given(), problem.frames()).empty()) {
    first.rotations = problem.frames().nodes_from(
        Rotations(static_cast<std::size_t>(problem.frames().num_variables), Matrix3::Identity()));
    first.components = components_without_world(problem);
  } else {
    SolveOptions rough = stop.heeding(options);
    rough.certify = false;
    rough.iteration.tolerance = std::max(options.iteration.tolerance, 1e-6);
    first = detail::solve_measurements(
        problem, std::move(start), [&](const MeasurementGraph& graph, std::optional<Rotations> R) {
          return solve(graph, rough, std::move(R));
        });
  }
  if (stop.made()) first.status = Status::stopped;
  return detail::meet_priors(problem, first, options, watch);
}

ROTAVG_INLINE Solution solve(const MeasurementGraph& graph, const Priors& priors,
                             const SolveOptions& options, std::optional<Rotations> start) {
  if (priors.empty()) return solve(graph, options, std::move(start));
  return solve(GroundedGraph(graph, priors), options, std::move(start));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

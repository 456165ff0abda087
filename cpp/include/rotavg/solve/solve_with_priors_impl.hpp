#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/alignment.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/solve/solve_impl.hpp>
#include <rotavg/solve/solve_with_priors.hpp>
#include <rotavg/solve/stopwatch.hpp>

namespace rotavg {

namespace detail {

/// What `solve` makes of the measurements alone, without what holds the world: between the frames
/// of rigs where there are some.
/// @param solve `Solution solve(const MeasurementGraph&, std::optional<Rotations> start)`, or of a
///        type derived from Solution
/// @returns its rotations and components are those of the given nodes
template <typename Solve>
auto solve_measurements(const GroundedGraph& problem, std::optional<Rotations> start,
                        Solve&& solve) {
  const MeasurementGraph& given = problem.given();
  if (problem.priors().rigs.empty()) return solve(given, std::move(start));
  if (start) start = problem.frames().variables_from(checked_rotations(given, *std::move(start)));
  const ReducedGraph between_frames(given, problem.frames());
  auto solution = solve(between_frames.graph(), std::move(start));
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

ROTAVG_INLINE Solution meet_priors(const GroundedGraph& problem, const Solution& first,
                                   SolveOptions options) {
  IterationOptions& limits = options.iteration;
  const bool stopped = first.status == Status::stopped;
  if (stopped) {
    limits.max_iterations = 0;
    limits.callback = nullptr;
  } else if (limits.callback && !problem.gravity().first.empty()) {
    double constant = 0.0;
    for (const Index k : problem.gravity().first) {
      constant += 8.0 * problem.graph().edges()[k].weight;
    }
    limits.callback = [constant, callback = limits.callback](Progress progress) {
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
  const Stopwatch watch;
  Solution first;
  if (start_is_solution && start) {
    first.rotations = checked_rotations(problem.given(), *std::move(start));
    first.components = connected_components(problem.given());
  } else {
    SolveOptions rough = options;
    rough.certify = false;
    rough.iteration.tolerance = std::max(options.iteration.tolerance, 1e-6);
    first = detail::solve_measurements(
        problem, std::move(start), [&](const MeasurementGraph& graph, std::optional<Rotations> R) {
          return solve(graph, rough, std::move(R));
        });
  }
  SolveOptions rest = options;
  rest.iteration.max_iterations = std::max(0, options.iteration.max_iterations - first.iterations);
  rest.iteration.time_limit = std::max(0.0, options.iteration.time_limit - watch.seconds());
  return detail::meet_priors(problem, first, rest);
}

ROTAVG_INLINE Solution solve(const MeasurementGraph& graph, const Priors& priors,
                             const SolveOptions& options, std::optional<Rotations> start) {
  if (priors.empty()) return solve(graph, options, std::move(start));
  return solve(GroundedGraph(graph, priors), options, std::move(start));
}

}  // namespace rotavg

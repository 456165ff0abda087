#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/reduction/alignment.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/robust_priors.hpp>
#include <rotavg/robust/solve_robust_impl.hpp>
#include <rotavg/robust/solve_robust_with_priors.hpp>
#include <rotavg/robust/stories.hpp>
#include <rotavg/solve/solve_with_priors_impl.hpp>
#include <rotavg/solve/stop_request.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Makes what was found of the measurements between frames what is told of all the given ones.
/// Those within a frame are constants, which are judged all the same, in the same units.
inline void tell_of_measurements(const GroundedGraph& problem, const RobustOptions& robust,
                                 int num_threads, RobustSolution& solution) {
  const MeasurementGraph& given = problem.given();
  const Riding& frames = problem.frames();
  std::vector<double> weights = given.weights();
  if (!robust.known.excluded.empty()) leave_out(robust.known.excluded, weights);
  const EdgeUnits units =
      edge_units(given, robust.known, robust.weight_kind, edges_between_variables(given, frames));
  const std::vector<double> x = squared_residuals(given, solution.rotations, num_threads);
  std::vector<EdgeVerdict> verdicts(weights.size(), EdgeVerdict::inlier);
  solution.edge_scales.clear();
  std::size_t between = 0;
  for (Index k = 0; k < given.num_edges(); ++k) {
    const Edge& e = given.edges()[k];
    const double precision = precision_of(units.precision, k);
    solution.edge_scales.push_back(1.0 / std::sqrt(precision));
    if (frames.joins(e.i, e.j)) {
      weights[k] = solution.edge_weights[between];
      verdicts[k] = solution.verdicts.edges[between++];
      continue;
    }
    const double share = std::max(least_weight_share, weight_share(solution.loss, x[k], precision));
    weights[k] = std::max(min_weight, share * weights[k]);
    if (precision * x[k] > solution.threshold * solution.threshold) {
      verdicts[k] = EdgeVerdict::robust_weight;
    }
    if (robust.known.trusts(k)) verdicts[k] = EdgeVerdict::trusted;
    if (robust.known.excludes(k)) verdicts[k] = EdgeVerdict::excluded;
  }
  std::vector<Index> part;
  for (const Index v : frames.variable) part.push_back(solution.verdicts.part[v]);
  solution.edge_weights = std::move(weights);
  solution.verdicts = {std::move(verdicts), std::move(part)};
  for (Alternative& story : solution.alternatives) {
    std::vector<Index> group;
    for (const Index v : frames.variable) group.push_back(story.group[v]);
    story.group = std::move(group);
    story.rotations = frames.nodes_from(story.rotations);
    story.missing.clear();  // pairs of frames
  }
}

/// Gives the priors their robust weights. First the components turn as a whole, as the priors that
/// agree have it; then measurements and priors are solved together, as the weights change, since
/// rotations that drift are held by their priors only there.
///
/// @param weighted with the robust weights of the measurements
/// @param stop heeded by the options
/// @param watch that has been running since the call began
/// @param solution of the measurements alone; receives where it ended, the verdicts, and what it
///        took
inline void weigh_priors(GroundedGraph& weighted, const SolveOptions& options,
                         const StopRequest& stop, const Stopwatch& watch,
                         RobustSolution& solution) {
  constexpr int turns = 40, rounds = 12;
  constexpr double settled = 1e-3;
  RobustPriors priors(weighted, solution.loss);
  const auto weigh = [&](bool rough) {
    const double change = priors.update(weighted, solution.rotations, rough);
    weighted.set_prior_weights(priors.absolute().weights, priors.gravity().weights);
    return change;
  };
  const auto turn = [&] {
    solution.rotations =
        aligned_with_priors(weighted, solution.components.label, std::move(solution.rotations));
  };
  const auto may_go_on = [&] {
    const IterationOptions& limits = options.iteration;
    return solution.status != Status::stopped && solution.iterations < limits.max_iterations &&
           watch.seconds() < limits.time_limit && !stop.made() &&
           (!limits.keep_going || limits.keep_going());
  };
  const double before = watch.seconds();
  turn();
  for (const bool rough : {true, false}) {
    for (int k = 0; k < turns && weigh(rough) > settled && may_go_on(); ++k) turn();
  }
  solution.timings.init += watch.seconds() - before;
  SolveOptions rough = options;
  rough.certify = false;
  rough.iteration.tolerance = std::max(options.iteration.tolerance, 1e-6);
  for (int k = 0; k < rounds && may_go_on(); ++k) {
    Solution met = meet_priors(weighted, solution, rough, watch);
    solution.rotations = std::move(met.rotations);
    solution.iterations = met.iterations;
    solution.timings = met.timings;
    if (met.status == Status::stopped || stop.made()) solution.status = Status::stopped;
    if (weigh(false) <= settled) break;
  }
  solution.absolute = priors.absolute();
  solution.gravity = priors.gravity();
}

/// Joins the parts that the world holds, by fixed nodes and absolute priors that are no outliers.
/// (Gravity leaves the heading open.)
inline void join_parts(const GroundedGraph& problem, RobustSolution& solution) {
  std::vector<bool> measurements;
  for (const EdgeVerdict verdict : solution.verdicts.edges) {
    measurements.push_back(!is_outlier(verdict));
  }
  std::vector<bool> absolute(problem.priors().absolute.size(), true);
  for (std::size_t k = 0; k < solution.absolute.is_outlier.size(); ++k) {
    absolute[k] = !solution.absolute.is_outlier[k];
  }
  const std::vector<bool> gravity(problem.priors().gravity.size(), false);
  const std::vector<Index> part =
      problem.parts_of_nodes(problem.edges_where(measurements, absolute, gravity));
  for (Index k = 0; k < problem.given().num_edges(); ++k) {
    const Edge& e = problem.given().edges()[k];
    EdgeVerdict& verdict = solution.verdicts.edges[k];
    if (verdict == EdgeVerdict::weak_part && part[e.i] == part[e.j]) {
      verdict = EdgeVerdict::robust_weight;
    }
  }
  solution.verdicts.part = part;
}

/// RobustSolution::num_strained: of the edges that were kept, and that have a threshold, where
/// cycles tell it.
/// @param before, after (m,) squared_residuals() before and after the priors were met
inline Index num_strained(const std::vector<double>& before, const std::vector<double>& after,
                          const RobustSolution& solution) {
  const auto& verdicts = solution.verdicts.edges;
  const auto is_checked = [](EdgeVerdict v) {
    return v == EdgeVerdict::inlier || v == EdgeVerdict::robust_weight;
  };
  if (std::none_of(verdicts.begin(), verdicts.end(), is_checked)) return 0;
  const double priors_do = std::max(solution.absolute.threshold, solution.gravity.threshold);
  Index strained = 0;
  for (std::size_t k = 0; k < verdicts.size(); ++k) {
    if (verdicts[k] != EdgeVerdict::inlier && verdicts[k] != EdgeVerdict::bridge) continue;
    const double threshold = std::max(solution.threshold * solution.edge_scales[k], priors_do);
    const double most = threshold * threshold;
    strained += before[k] <= most && after[k] > 4.0 * most;
  }
  return strained;
}

/// What is known of the measurements between frames.
inline EdgeKnowledge between_frames(const GroundedGraph& problem, const EdgeKnowledge& known) {
  return known.of(edges_between_variables(problem.given(), problem.frames()));
}

}  // namespace detail

ROTAVG_INLINE RobustSolution solve_robust(const GroundedGraph& problem,
                                          const SolveOptions& given_options,
                                          const RobustOptions& robust,
                                          std::optional<Rotations> start) {
  check(given_options);
  const Stopwatch watch;
  const StopRequest stop;
  const SolveOptions options = stop.heeding(given_options);
  robust.known.check(problem.given());
  const int num_threads =
      resolve_num_threads(options.iteration.num_threads, problem.given().num_edges());
  SolveOptions rough = options;
  if (problem.has_world()) {
    rough.certify = false;
    rough.iteration.tolerance = std::max(options.iteration.tolerance, 1e-6);
  }
  RobustSolution solution = detail::solve_measurements(
      problem, std::move(start), [&](const MeasurementGraph& graph, std::optional<Rotations> R) {
        RobustOptions between = robust;
        between.known = detail::between_frames(problem, robust.known);
        return solve_robust(graph, rough, between, std::move(R));
      });
  if (!problem.priors().rigs.empty()) {
    detail::tell_of_measurements(problem, robust, num_threads, solution);
  }
  if (!problem.has_world()) {
    if (problem.priors().rigs.empty()) return solution;
    GroundedGraph weighted = problem;
    weighted.set_weights(solution.edge_weights);
    solution.objective = objective(weighted, solution.rotations);
    return solution;
  }
  if (stop.made()) solution.status = Status::stopped;
  const auto residuals_now = [&] {
    return squared_residuals(problem.given(), solution.rotations, num_threads);
  };
  const std::vector<double> before = residuals_now();
  GroundedGraph weighted = problem;
  weighted.set_weights(solution.edge_weights);
  const std::vector<Index> component = solution.components.label;  // by measurements alone
  if (robust.priors && solution.loss.kind != Loss::l2) {
    detail::weigh_priors(weighted, options, stop, watch, solution);
  }
  detail::join_parts(problem, solution);
  static_cast<Solution&>(solution) = detail::meet_priors(weighted, solution, options, watch);
  solution.num_strained = detail::num_strained(before, residuals_now(), solution);
  for (Alternative& story : solution.alternatives) {
    adopt_gauge(component, story.group, solution.rotations, story.rotations);
  }
  return solution;
}

ROTAVG_INLINE RobustSolution solve_robust(const MeasurementGraph& graph, const Priors& priors,
                                          const SolveOptions& options, const RobustOptions& robust,
                                          std::optional<Rotations> start) {
  if (priors.empty()) return solve_robust(graph, options, robust, std::move(start));
  return solve_robust(GroundedGraph(graph, priors), options, robust, std::move(start));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

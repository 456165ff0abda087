#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/staircase.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

inline bool is_certified(const ComponentCertificate& certificate) {
  return certificate.verdict == Verdict::proved || certificate.verdict == Verdict::estimated;
}

/// Whether a solution has converged to something that is not certified, and the limits allow more.
/// Where S is positive, another start would lead to the same.
inline bool is_refuted(const SolveRun& run, const Solution& solution) {
  return run.options().certify && is_converged(solution.status) &&
         solution.certificate.verdict == Verdict::not_certified &&
         solution.certificate.shortfall != Shortfall::leftover && run.may_go_on();
}

/// Whether a is to replace b. A certified answer wins a tie, for its certificate; but where b is
/// lower by more than the gap, the certificate of a, an estimate, is wrong.
inline bool is_better(const Solution& a, const Solution& b) {
  return is_certified(a.certificate) ? a.objective <= b.objective + a.certificate.gap
                                     : a.objective < b.objective;
}

/// A second run; the better solution stays.
inline void try_chordal_start(SolveRun& run, Solution& solution) {
  const double before = run.seconds();
  Solution second;
  const Rotations R = run.initial_value(Initialization::chordal, second.init);
  solution.timings.init += run.seconds() - before;
  if (second.init != Initialization::chordal) return;
  second.timings = solution.timings;
  run.from(R, Method::automatic, second);
  const bool better = is_better(second, solution);
  solution.timings = second.timings;
  if (better) solution = std::move(second);
  solution.reason += better ? "; a second run, from the chordal start, did better"
                            : "; a second run, from the chordal start, did no better";
}

/// The way down from the staircase: a run from what it came to; the better solution stays.
inline void go_down(SolveRun& run, const Rotations& R, Solution& solution) {
  Solution next = solution;
  run.from(R, Method::automatic, next);
  if (solution.status == Status::not_run || is_better(next, solution)) {
    next.reason = solution.reason;
    solution = std::move(next);
  } else {
    solution.timings = next.timings;
  }
}

/// Up the staircase of a connected graph, and down from every step, until what is met there is
/// certified, or the relaxation is solved, or a limit is reached.
/// @param R where to start
/// @param solution not run yet, or what is refuted at R; the better one stays
/// @returns what it did, in words; empty where it took no step
inline std::string climb(SolveRun& run, const Rotations& R, Solution& solution) {
  const SolveOptions& options = run.options();
  double before = run.seconds();
  Staircase staircase(run.graph(), run.components(), 0, run.eliminations()[0], R,
                      resolve_num_threads(options.iteration.num_threads, run.graph().num_edges()),
                      run.max_start_flops(), run.keep_going());
  while (staircase.next_rank() <= options.max_rank && run.may_go_on()) {
    const int iterations = staircase.iterations();
    const bool climbed = staircase.climb(run.limits());
    run.count(staircase.iterations() - iterations);
    solution.timings.solve += run.seconds() - before;
    if (!climbed) break;
    go_down(run, staircase.rounded(), solution);
    if (is_certified(solution.certificate)) break;
    before = run.seconds();
  }
  if (staircase.iterations() == 0) return {};
  if (options.certify && !is_certified(solution.certificate)) {
    before = run.seconds();
    run.lower_bound(0) = staircase.lower_bound();
    solution.timings.certify += run.seconds() - before;
    run.certify(solution);
  }
  return staircase.report(is_certified(solution.certificate));
}

/// Climbs in every component that is not certified, each as a graph of its own.
/// @param R where to start; receives where it ended
/// @param solution receives the time it took
inline std::string climb_by_component(SolveRun& run, Rotations& R, Solution& solution) {
  const Components& components = run.components();
  const auto& certificates = solution.certificate.components;
  std::string report;
  for (Index c = 0; c < components.size() && run.may_go_on(); ++c) {
    const std::vector<Index>& nodes = components.nodes[c];
    if (nodes.size() < 2 || (!certificates.empty() && is_certified(certificates[c]))) continue;
    const MeasurementGraph graph = component_graph(run.graph(), components, c);
    SolveOptions options = run.options();
    options.iteration = run.limits();
    SolveRun part_run(graph, options);
    Rotations part;
    for (const Index i : nodes) part.push_back(R[i]);
    Solution climbed;
    const std::string said = climb(part_run, part, climbed);
    solution.timings.solve += climbed.timings.solve;
    solution.timings.certify += climbed.timings.certify;
    if (said.empty()) continue;
    run.lower_bound(c) = part_run.lower_bound(0);
    if (is_certified(climbed.certificate) || climbed.objective < objective(graph, part)) {
      for (std::size_t a = 0; a < nodes.size(); ++a) R[nodes[a]] = climbed.rotations[a];
    }
    run.count(part_run.iterations());
    report += (report.empty() ? "" : "; ") + said;
  }
  return report;
}

inline void climb_from(SolveRun& run, Rotations R, Solution& solution) {
  std::string report;
  if (run.components().size() == 1) {
    report = climb(run, R, solution);
  } else if (run.options().max_rank >= Staircase::first_rank) {
    report = climb_by_component(run, R, solution);
    if (!report.empty()) go_down(run, R, solution);
  }
  if (solution.status == Status::not_run) run.from(R, Method::automatic, solution);
  if (report.empty()) return;
  solution.method = Method::staircase;
  solution.reason += (solution.reason.empty() ? "" : "; ") + report;
}

/// All runs of one call of solve().
inline Solution solve(SolveRun& run, std::optional<Rotations> start) {
  const SolveOptions& options = run.options();
  const bool given = start.has_value(), automatic = options.method == Method::automatic;
  Solution solution;
  const Rotations R = given ? checked_rotations(run.graph(), *std::move(start))
                            : run.initial_value(options.init, solution.init);
  solution.timings.init = run.seconds();
  if (options.method == Method::staircase) {
    detail::climb_from(run, R, solution);
  } else {
    const bool chosen = !given && options.init == Initialization::automatic;
    using Origin = SolveRun::Origin;
    run.from(R, options.method, solution,
             given    ? Origin::given
             : chosen ? Origin::automatic
                      : Origin::named);
    if (automatic && chosen && solution.init != Initialization::chordal &&
        detail::is_refuted(run, solution)) {
      detail::try_chordal_start(run, solution);
    }
    if (automatic && detail::is_refuted(run, solution)) {
      detail::climb_from(run, solution.rotations, solution);
    }
  }
  run.stop().tell(solution, automatic || options.method == Method::staircase);
  return solution;
}

}  // namespace detail

ROTAVG_INLINE Solution solve(const MeasurementGraph& graph, const SolveOptions& options,
                             std::optional<Rotations> start) {
  SolveRun run(graph, options);
  return detail::solve(run, std::move(start));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

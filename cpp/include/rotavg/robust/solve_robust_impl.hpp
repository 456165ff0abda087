#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/checked_part.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/robust/approach.hpp>
#include <rotavg/robust/approach_by_odometry.hpp>
#include <rotavg/robust/cycles.hpp>
#include <rotavg/robust/default_scale.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/edge_verdicts.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/portfolio.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/settling.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/stories.hpp>
#include <rotavg/robust/tails.hpp>
#include <rotavg/robust/thresholds.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

constexpr double pi = 3.141592653589793;

/// In words, for people, hence in degrees.
inline std::string describe(const Approach& approach, int reweightings) {
  std::ostringstream text;
  text.precision(2);
  const Index moved = approach.consensus.moved;
  text << reweightings << " reweightings at the scale of "
       << approach.settled.loss.scale * 180.0 / pi << " deg, after " << approach.l1_reweightings
       << " of l1" << approach.manner << " and " << moved << (moved == 1 ? " node" : " nodes")
       << " moved by votes";
  return text.str();
}

/// What other starts led to, in words; empty if none was tried.
inline std::string describe(const Portfolio& portfolio) {
  std::ostringstream text;
  if (portfolio.turned > 0) {
    text << "; " << portfolio.turned << (portfolio.turned == 1 ? " part" : " parts")
         << " turned as likely edges say";
  }
  if (portfolio.tried <= 1) return text.str();
  text << "; " << portfolio.tried << " starts led to ";
  if (portfolio.different == 1) {
    text << "one answer";
  } else {
    text << portfolio.different << " answers, and " << portfolio.judge << " chose "
         << (portfolio.replaced ? "that of " : "") << portfolio.best.start;
  }
  return text.str();
}

/// The alternatives on the whole graph, told by residuals at one scale.
///
/// @param graph with the given weights
/// @param left_out (m,) edges that count for nothing; empty for none
/// @param R the answer
inline std::vector<Alternative> told(const MeasurementGraph& graph,
                                     const std::vector<bool>& left_out, const CheckedPart& part,
                                     const Portfolio& portfolio, const Rotations& R, double noise,
                                     const std::vector<double>& precision, int num_threads) {
  const auto residuals_at = [&](const Rotations& rotations) {
    std::vector<double> x = squared_residuals(graph, rotations, num_threads);
    for (std::size_t k = 0; k < x.size(); ++k) {
      x[k] *= precision_of(precision, k) / (noise * noise);
      if (!left_out.empty() && left_out[k]) x[k] = 0.0;
    }
    return x;
  };
  const std::vector<double> x = residuals_at(R);
  std::vector<Alternative> alternatives;
  for (const Story& story : portfolio.alternatives) {
    Rotations S = part.extended(story.rotations);
    const std::vector<double> other_x = residuals_at(S);
    auto group = shared_groups(graph, R, S, step_tolerance(noise));
    if (std::all_of(group.begin(), group.end(), [](Index g) { return g == 0; })) continue;
    Comparison evidence = portfolio.evidence->compare(part.of_edges(x), part.of_edges(other_x));
    if (evidence.only_other.empty()) continue;  // at this scale it explains nothing more
    alternatives.push_back(alternative_story(graph, R, x, std::move(S), other_x, std::move(group)));
    Alternative& told = alternatives.back();
    told.evidence = std::move(evidence);
    told.closure = portfolio.evidence->closure(told.evidence.only_other);
    told.answer_closure = portfolio.evidence->closure(told.evidence.only_first);
  }
  return alternatives;
}

/// (m,) edges that the cycle check leaves out: none that is trusted.
inline std::vector<bool> refuted_edges(const MeasurementGraph& graph, const SolveOptions& options,
                                       const RobustOptions& robust, const Stopwatch& watch) {
  const IterationOptions& limits = options.iteration;
  const auto evidence = cycle_evidence(graph, robust.cycle_threshold, [&] {
    return watch.seconds() < limits.time_limit && (!limits.keep_going || limits.keep_going());
  });
  std::vector<bool> refuted;
  for (const CycleEvidence& e : evidence) {
    const auto k = static_cast<Index>(refuted.size());
    refuted.push_back(e.refuted(robust.min_cycles) && !robust.known.trusts(k));
  }
  return refuted;
}

/// @throws std::invalid_argument for an option out of range, or knowledge that does not fit
inline void check(const RobustOptions& robust, const MeasurementGraph& graph) {
  if (robust.scale != 0.0 && !is_loss_scale(robust.scale)) {
    throw std::invalid_argument("found the scale " + six_digits(robust.scale) +
                                "; expected radians between 1e-6 and pi, or 0: from the noise");
  }
  if (!(robust.cycle_threshold >= 0.0 && robust.cycle_threshold <= pi)) {
    throw std::invalid_argument("found the cycle threshold " + six_digits(robust.cycle_threshold) +
                                "; expected radians between 0 and pi");
  }
  if (robust.min_cycles < 1) throw std::invalid_argument("min_cycles is less than 1");
  robust.known.check(graph);
}

}  // namespace detail

ROTAVG_INLINE RobustSolution solve_robust(const MeasurementGraph& graph,
                                          const SolveOptions& options, const RobustOptions& robust,
                                          std::optional<Rotations> start) {
  constexpr int brief_limit = 30;
  check(options);
  detail::check(robust, graph);
  const Stopwatch watch;
  std::vector<bool> refuted, left_out = robust.known.excluded;
  if (robust.cycle_threshold > 0.0) {
    refuted = detail::refuted_edges(graph, options, robust, watch);
    left_out.resize(refuted.size(), false);
    for (std::size_t k = 0; k < refuted.size(); ++k) left_out[k] = left_out[k] || refuted[k];
  }
  EdgeUnits units = edge_units(graph, robust.known, robust.weight_kind);
  std::vector<double> given = graph.weights();
  MeasurementGraph weighted = graph;
  if (!left_out.empty()) {
    leave_out(left_out, given);
    leave_out(left_out, units.voices);
    weighted.set_weights(given);
  }
  const CheckedPart part(weighted, left_out);
  const double freedom = part.series().freedom();
  RobustRun run(part.graph(), options, part.series_of_part(),
                {part.of_edges(units.precision), part.of_edges(units.free_precision),
                 part.of_edges(units.voices), units.voice},
                watch);

  // 1. to 4.
  detail::ApproachOptions rules;
  rules.knows_weights = !robust.known.initial_weights.empty();
  rules.starts_near = start && robust.continues;
  rules.starts_freely = !start && options.init == Initialization::automatic && !rules.knows_weights;
  const bool compares =
      robust.loss == Loss::automatic && !start && options.init == Initialization::automatic;
  rules.most_reweightings = compares ? brief_limit : detail::most_reweightings;
  Initialization init = Initialization::automatic;
  run.judge(Judging::evenly);
  const Rotations R0 = start ? part.of_nodes(checked_rotations(graph, std::move(*start)))
                             : run.least_squares(part.of_edges(robust.known.initial_weights), init);
  const std::vector<bool> odometry =
      detail::counted_odometry(part, run, rules, robust.known.odometry);
  detail::Approach approach =
      detail::approach_by_odometry(run, part, R0, {robust.loss, robust.scale}, rules, odometry);
  if (approach.from_chordal) init = Initialization::chordal;
  if (approach.from_tree) init = Initialization::maximum_spanning_tree;
  RobustLoss& loss = approach.settled.loss;
  double& noise = approach.settled.noise;
  IterationResult& reweighted = approach.settled.result;

  std::vector<double> precision = units.precision;  // by which the loss judges residuals
  std::vector<bool> favoured;
  if (!approach.favoured.empty()) favoured = part.of_whole(approach.favoured);
  favour(favoured, precision);

  // 5.
  const auto go_on = [&] { return run.ended() == Status::not_run; };
  Portfolio portfolio;
  if (compares && go_on()) {
    const double loss_noises = default_scale(loss.kind, freedom);
    portfolio = find_stories(run, part.graph(), loss_noises, reweighted.rotations, noise,
                             {approach.grown, approach.given_up, odometry});
    if (portfolio.replaced) {
      noise = portfolio.best.noise;
      if (robust.scale == 0.0) loss.scale = loss_noises * noise;
    }
    if (portfolio.replaced || portfolio.turned > 0 ||
        reweighted.status == Status::iteration_limit) {
      reweighted = run.reweighted(portfolio.best.rotations, loss, detail::settled_gain,
                                  detail::most_reweightings);
    }
  }

  // 6.
  const int space = turns_about_one_axis(part.graph()) ? 1 : 3;
  if (robust.loss == Loss::automatic && robust.scale == 0.0 && go_on()) {
    settle_on_normal_noise(run, space, noise, loss, reweighted);
  }
  const double reweighting_seconds = run.seconds() - approach.prepared;

  // 7.
  Rotations R = part.extended(reweighted.rotations);
  const auto residuals_now = [&] { return squared_residuals(graph, R, run.num_threads()); };
  std::vector<double> x = residuals_now(), weights;
  robust_weights(given, x, loss, precision, run.num_threads(), weights);
  // What is left of edges that were left out is no matter of the loss, and gives way to all that is
  // known besides: rejected priors keep as large a share as leave_out() leaves.
  std::vector<double> counted = given;
  for (std::size_t k = 0; k < left_out.size(); ++k) {
    if (!left_out[k]) continue;
    weights[k] = std::max(min_weight, least_weight_share * given[k]);
    counted[k] = 0.0;
  }
  weighted.set_weights(weights);
  Status early = run.ended();
  if (go_on() && reweighted.status == Status::iteration_limit) early = Status::iteration_limit;
  RobustSolution solution;
  static_cast<Solution&>(solution) =
      solve(weighted, run.stage(go_on() ? options.iteration.max_iterations : 0), std::move(R));
  if (early != Status::not_run) solution.status = early;
  solution.init = init;
  solution.iterations += run.iterations();
  solution.trace = std::move(reweighted.trace);
  solution.timings.init += approach.prepared;
  solution.timings.solve += reweighting_seconds;
  solution.reason = detail::describe(approach, reweighted.iterations) +
                    detail::describe(portfolio) +
                    (solution.reason.empty() ? "" : "; then " + solution.reason);

  R = solution.rotations;
  x = residuals_now();
  if (!portfolio.alternatives.empty()) {
    solution.alternatives = detail::told(graph, left_out, part, portfolio, R, noise,
                                         units.precision, run.num_threads());
  }
  solution.loss = loss;
  solution.noise = noise;
  solution.noise_shows = noise < most_noise;
  solution.moved_by_votes = approach.consensus.moved;
  solution.edge_weights = std::move(weights);
  solution.robust_objective = robust_objective(counted, x, loss, precision, run.num_threads());
  const Thresholds threshold =
      thresholds(loss, noise, run.series_residuals_at(part.of_nodes(R)), space);
  solution.threshold = threshold.told;
  solution.verdicts = edge_verdicts(graph, part.series(), x, units.precision, threshold.doubtful,
                                    robust.known, refuted);
  solution.favoured = std::move(favoured);
  solution.edge_scales.reserve(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) {
    solution.edge_scales.push_back(1.0 / std::sqrt(precision_of(units.precision, k)));
  }
  return solution;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

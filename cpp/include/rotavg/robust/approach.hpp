#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/checked_part.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/robust/agreeing_closures.hpp>
#include <rotavg/robust/consensus.hpp>
#include <rotavg/robust/growing.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/settling.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Whether l1 may end far off: it all but does not depend on the start where edges are many.
inline bool has_few_edges(const MeasurementGraph& graph) {
  constexpr double few = 12.0;  // at a node
  return 2.0 * graph.num_edges() <= few * graph.num_nodes();
}

/// Whether more than noise or a few wrong edges contradict rotations.
inline bool many_contradict(RobustRun& run, const Rotations& R) {
  constexpr double many = 0.02;
  const std::vector<double> x = run.series_residuals_at(R);
  const double most = outlier_noises * run.noise_at(R);
  const auto beyond =
      std::count_if(x.begin(), x.end(), [&](double x_s) { return x_s > most * most; });
  return static_cast<double>(beyond) > many * static_cast<double>(x.size());
}

struct ApproachOptions {
  bool knows_weights = false;  ///< the start is that of robust weights
  bool starts_near = false;    ///< neither l1 nor graduated non-convexity goes before
  bool starts_freely = false;  ///< neither a start nor an initialisation was asked for
  int most_reweightings = 0;
};

/// From a start to where the loss has settled: l1, what many agree on, the loss.
struct Approach {
  Settling settled;
  Consensus consensus;
  int l1_reweightings = 0;
  bool from_chordal = false, from_tree = false;
  /// Where grown_from_tree() has led, if it was one of the starts.
  std::optional<Rotations> grown;
  /// Another answer, which bends odometry where this one does not, or the other way round.
  std::optional<Rotations> given_up;
  std::vector<bool> favoured;  ///< odometry (m,) that the loss has favoured, or empty
  double prepared = 0.0;       ///< seconds of the run, before the loss
  std::string manner;          ///< how l1 was judged, in words, where that is not as usual
};

inline Approach approach(RobustRun& run, const CheckedPart& part, const Rotations& start,
                         const RobustLoss& asked, const ApproachOptions& rules, Judging judging) {
  constexpr double l1_scale = 0.01, l1_gain = 1e-3;
  constexpr int l1_limit = 60;
  const MeasurementGraph& graph = part.graph();
  const double freedom = part.series().freedom();
  Approach found;
  run.judge(judging);
  const auto with_l1 = [&](const Rotations& R) {
    return run.reweighted(R, {Loss::l1, l1_scale}, l1_gain,
                          rules.knows_weights || rules.starts_near ? 0 : l1_limit);
  };
  IterationResult l1 = with_l1(start);
  if (rules.starts_freely && has_few_edges(graph) && run.ended() == Status::not_run &&
      many_contradict(run, l1.rotations)) {
    if (const auto chordal = run.least_squares_from_chordal()) {
      IterationResult other = with_l1(*chordal);
      if (other.objective < l1.objective) {
        l1 = std::move(other);
        found.from_chordal = true;
      }
    }
  }
  found.l1_reweightings = l1.iterations;
  found.consensus = find_consensus(run, graph, l1.rotations);
  found.prepared = run.seconds();
  found.settled = settle(run, asked, freedom, found.consensus,
                         {start, std::move(l1.rotations), found.consensus.rotations},
                         !rules.starts_near, rules.most_reweightings);
  if (run.trusts_any() && judging != Judging::evenly) {  // so far none was
    run.judge(Judging::in_own_units);
    found.settled.result = run.reweighted(found.settled.result.rotations, found.settled.loss,
                                          settled_gain, rules.most_reweightings);
  }
  return found;
}

/// Whether hardly any edge closes a cycle, as on a trajectory with some loop closures: there voices
/// of one size would let a closure bend thousands of edges, each a little.
inline bool is_chain(const MeasurementGraph& graph, Index num_cycles) {
  constexpr double hardly_any = 0.1;
  return num_cycles > 0 && num_cycles <= hardly_any * graph.num_edges();
}

/// The objective at a loss: what has settled at a larger scale is not at its least at a smaller
/// one, and goes on for a little.
inline double objective_at(RobustRun& run, const Settling& settled, const RobustLoss& loss) {
  constexpr double fair_gain = 1e-3;
  constexpr int fair_limit = 10;
  if (settled.loss.scale <= loss.scale) return run.objective_at(settled.result.rotations, loss);
  return run.reweighted(settled.result.rotations, loss, fair_gain, fair_limit).objective;
}

/// The approach that ends with the least objective, at the smaller of two scales: l1 gives every
/// edge one voice, since a precision may be wrong, but for trusted edges. These it takes at their
/// word, which holds a chain so stiffly that right closures may seem wrong; so it is tried without
/// trust, too, and, where precisions differ and there is trust or a chain, with the precisions as
/// they are. With trust closures that agree with one another are a start, too; edges that bear one
/// another out are a start as well, with trust, and where precisions differ and there is a chain,
/// or edges are few and many contradict.
inline Approach best_approach(RobustRun& run, const CheckedPart& part, const Rotations& start,
                              const RobustLoss& asked, const ApproachOptions& rules) {
  const MeasurementGraph& graph = part.graph();
  Approach best = approach(run, part, start, asked, rules, Judging::evenly);
  if (rules.knows_weights || rules.starts_near || asked.kind == Loss::l2 || run.trusts_all()) {
    return best;
  }
  constexpr int brief_limit = 30;
  const auto try_with = [&](const Rotations& R, bool from_tree, Judging judging,
                            const ApproachOptions& by, const char* manner) -> Rotations {
    if (run.ended() != Status::not_run) return R;
    Approach other = approach(run, part, R, asked, by, judging);
    other.from_tree = from_tree && !other.from_chordal;
    Rotations led_to = other.settled.result.rotations;
    RobustLoss loss = best.settled.loss;
    loss.scale = std::min(loss.scale, other.settled.loss.scale);
    if (objective_at(run, other.settled, loss) < objective_at(run, best.settled, loss)) {
      best = std::move(other);
      best.manner = manner;
    }
    return led_to;
  };
  const bool trusts = run.trusts_any();
  if (trusts) {
    try_with(start, false, Judging::freely_and_evenly, rules, " that trusted none");
  }
  const bool chain = is_chain(graph, part.series().num_cycles);
  if (run.has_own_units() && (trusts || chain)) {
    // Of a chain least squares are bent by wrong closures so far that l1 does not find back.
    const Rotations R = chain ? along_spanning_tree(graph, run.given(), run.keep_going()) : start;
    try_with(R, chain, Judging::freely_in_own_units, rules,
             trusts ? " by precision that trusted none" : " by precision");
  }
  const auto is_doubtful = [&] {
    return has_few_edges(graph) && many_contradict(run, best.settled.result.rotations);
  };
  const bool grows = trusts || (run.has_own_units() && (chain || is_doubtful()));
  ApproachOptions near = rules;
  near.starts_near = true;
  near.starts_freely = false;
  near.most_reweightings = std::min(rules.most_reweightings, brief_limit);
  if (trusts && run.ended() == Status::not_run) {
    const auto closures =
        agreeing_closures(graph, run.trusted(), run.free_precision(), best.settled.noise);
    try_with(run.agreed_by(closures), false, Judging::freely_in_own_units, near,
             ", from closures that agree with one another,");
  }
  if (grows && run.ended() == Status::not_run) {
    if (const auto grown = grown_from_tree(run, graph)) {
      best.grown = try_with(*grown, true, Judging::freely_in_own_units, near,
                            ", from edges that bear one another out,");
    }
  }
  if (best.settled.result.status == Status::iteration_limit &&
      rules.most_reweightings > brief_limit) {
    best.settled.result = run.reweighted(best.settled.result.rotations, best.settled.loss,
                                         settled_gain, rules.most_reweightings);
  }
  return best;
}

}  // namespace detail

}  // namespace rotavg

#pragma GCC diagnostic pop

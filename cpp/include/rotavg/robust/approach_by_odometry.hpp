#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/graph/checked_part.hpp>
#include <rotavg/robust/agreeing_closures.hpp>
#include <rotavg/robust/approach.hpp>
#include <rotavg/robust/doubted_steps.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/odometry.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/solve/status.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// The best approach to a graph of few edges, some of which are odometry. Where it bends odometry,
/// or many edges contradict it, more are tried: from an answer that trusts odometry; from closures
/// that agree with one another (agreeing_closures), which tell where odometry is wrong; and from
/// the best so far without the steps that its closures contradict (without_doubted_steps). From
/// these the automatic loss goes on with odometry favoured, and takes of all answers the one that
/// less contradicts (contradictions); any other loss takes the one with the least objective.
///
/// @param odometry (m,), or empty: then this is best_approach, as it is with trust or a start
inline Approach approach_by_odometry(RobustRun& run, const CheckedPart& part,
                                     const Rotations& start, const RobustLoss& asked,
                                     const ApproachOptions& rules,
                                     const std::vector<bool>& odometry) {
  std::vector<Approach> found{best_approach(run, part, start, asked, rules)};
  const auto goes_on = [&] { return run.ended() == Status::not_run; };
  const Settling& free = found[0].settled;
  if (odometry.empty() || run.trusts_any() || !rules.starts_freely || asked.kind == Loss::l2 ||
      !has_few_edges(part.graph()) || !goes_on() ||
      !(bends_odometry(run, free.result.rotations, odometry, free.noise) ||
        many_contradict(run, free.result.rotations))) {
    return std::move(found[0]);
  }
  double noise = free.noise;
  ApproachOptions near = rules;
  near.starts_near = true;
  near.starts_freely = false;
  const bool favours = asked.kind == Loss::automatic;
  const auto go_on_from = [&](const Rotations& R, std::vector<bool> steps, const char* manner) {
    if (!goes_on()) return;
    if (favours) run.favour_odometry(steps);
    found.push_back(approach(run, part, R, asked, near, Judging::freely_in_own_units));
    run.favour_odometry({});
    Approach& one = found.back();
    if (favours) one.favoured = std::move(steps);
    one.manner = manner;
    // What meets hardly more than a tree, as odometry alone may be, shows no noise and no answer.
    if (!is_met_beyond_tree(run.series_residuals_at(one.settled.result.rotations),
                            part.series().num_cycles, outlier_noises * one.settled.noise)) {
      found.pop_back();
    } else {
      noise = std::min(noise, one.settled.noise);
    }
  };
  run.trust(odometry);
  Approach trusting = best_approach(run, part, start, asked, rules);
  run.trust({});
  go_on_from(trusting.settled.result.rotations, odometry, ", from an answer that trusts odometry,");
  if (goes_on()) {
    const auto closures = agreeing_closures(part.graph(), odometry, run.free_precision(), noise);
    go_on_from(run.agreed_by(closures), odometry, ", from closures that agree with one another,");
  }
  const auto best_so_far = [&] {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    RobustLoss loss = found[0].settled.loss;
    for (const Approach& one : found) loss.scale = std::min(loss.scale, one.settled.loss.scale);
    for (std::size_t k = 0; k < found.size() && goes_on(); ++k) {
      const Settling& settled = found[k].settled;
      const double against = favours
                                 ? contradictions(run, settled.result.rotations, odometry, noise)
                                 : objective_at(run, settled, loss);
      if (against < least) best = k;
      least = std::min(least, against);
    }
    return best;
  };
  std::size_t best = best_so_far();
  if (const auto without = without_doubted_steps(
          run, part.graph(), found[best].settled.result.rotations, odometry, noise)) {
    std::vector<bool> steps = odometry;
    for (std::size_t k = 0; k < steps.size(); ++k) steps[k] = steps[k] && !without->given_up[k];
    go_on_from(without->rotations, std::move(steps),
               ", without steps that many closures contradict,");
    best = best_so_far();
  }
  if (best > 0) {
    run.favour_odometry(found[best].favoured);
    found[best].grown = trusting.grown;
    found[best].given_up = found[0].settled.result.rotations;
  } else if (found.size() > 1) {
    found[0].given_up = found[1].settled.result.rotations;
  }
  return std::move(found[best]);
}

}  // namespace detail

}  // namespace rotavg

#pragma GCC diagnostic pop

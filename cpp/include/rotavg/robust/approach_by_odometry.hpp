#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
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

/// The odometry (m,) that counts: all of it where nothing is trusted, no start was given, and three
/// edges in ten close a cycle, or fewer; else none, an empty mask. (Where more do, as along a
/// sequence of photographs, edges are checked by others near by, and ids have no say.)
inline std::vector<bool> counted_odometry(const CheckedPart& part, const RobustRun& run,
                                          const ApproachOptions& rules,
                                          const std::vector<bool>& odometry) {
  constexpr double few = 0.3;
  std::vector<bool> counted = part.of_edges(odometry);
  const bool counts = rules.starts_freely && !run.trusts_any() &&
                      part.series().num_cycles <= few * part.graph().num_edges() &&
                      std::find(counted.begin(), counted.end(), true) != counted.end();
  if (!counts) counted.clear();
  return counted;
}

/// The answers of approach_by_odometry, and the best of them so far.
class OdometryApproaches {
 public:
  OdometryApproaches(RobustRun& run, const CheckedPart& part, const std::vector<bool>& odometry,
                     const RobustLoss& asked, Approach first)
      : run_(run),
        part_(part),
        odometry_(odometry),
        asked_(asked),
        noise_(first.settled.noise),
        best_(std::move(first)) {}

  double noise() const { return noise_; }
  const Rotations& rotations() const { return best_.settled.result.rotations; }

  /// The loss goes on from a start, with these steps (m,) favoured if it is the automatic one.
  void go_on_from(const Rotations& start, const std::vector<bool>& steps, ApproachOptions rules,
                  const char* manner) {
    rules.starts_near = true;
    rules.starts_freely = false;
    if (chooses_by_mishaps()) run_.favour_odometry(steps);
    Approach other = approach(run_, part_, start, asked_, rules, Judging::freely_in_own_units);
    run_.favour_odometry({});
    if (chooses_by_mishaps()) other.favoured = steps;
    other.manner = manner;
    // What meets hardly more than a tree, as odometry alone may be, shows no noise and no answer.
    const Rotations& R = other.settled.result.rotations;
    const bool shows = is_met_beyond_tree(run_.series_residuals_at(R), part_.series().num_cycles,
                                          outlier_noises * other.settled.noise);
    if (run_.ended() != Status::not_run || !shows) return;
    noise_ = std::min(noise_, other.settled.noise);
    if (is_better(other)) std::swap(best_, other);
    other_ = std::move(other.settled.result.rotations);
  }

  /// The best, with the last that was not preferred; its odometry is favoured from now on.
  Approach result() {
    run_.favour_odometry(best_.favoured);
    best_.given_up = std::move(other_);
    return std::move(best_);
  }

 private:
  bool chooses_by_mishaps() const { return asked_.kind == Loss::automatic; }
  bool is_better(const Approach& other) {
    if (chooses_by_mishaps()) {
      const auto of = [&](const Approach& one) {
        return mishaps(run_, part_.graph(), one.settled.result.rotations, odometry_, noise_);
      };
      return of(other) < of(best_);
    }
    RobustLoss loss = best_.settled.loss;
    loss.scale = std::min(loss.scale, other.settled.loss.scale);
    return objective_at(run_, other.settled, loss) < objective_at(run_, best_.settled, loss);
  }

  RobustRun& run_;
  const CheckedPart& part_;
  const std::vector<bool>& odometry_;
  RobustLoss asked_;
  double noise_;  // the least so far
  Approach best_;
  std::optional<Rotations> other_;
};

/// The best approach to a graph most edges of which are odometry. Where it bends odometry, or many
/// edges contradict it, more are tried: from an answer that trusts odometry; from closures that
/// agree with one another (agreeing_closures), which tell where odometry is wrong; and from the
/// best so far without the steps that its closures contradict (without_doubted_steps). From these
/// the automatic loss goes on with odometry favoured, and takes of all answers the one for which
/// least must have gone wrong (mishaps); any other loss takes the one with the least objective.
///
/// @param odometry of counted_odometry; empty: this is best_approach
inline Approach approach_by_odometry(RobustRun& run, const CheckedPart& part,
                                     const Rotations& start, const RobustLoss& asked,
                                     const ApproachOptions& rules,
                                     const std::vector<bool>& odometry) {
  Approach free = best_approach(run, part, start, asked, rules);
  const auto goes_on = [&] { return run.ended() == Status::not_run; };
  const Rotations& R = free.settled.result.rotations;
  if (odometry.empty() || asked.kind == Loss::l2 || !goes_on() ||
      !(bends_odometry(run, R, odometry, free.settled.noise) || many_contradict(run, R))) {
    return free;
  }
  const std::optional<Rotations> grown_freely = free.grown;
  OdometryApproaches found(run, part, odometry, asked, std::move(free));
  run.trust(odometry);
  const Approach trusting = best_approach(run, part, start, asked, rules);
  run.trust({});
  if (goes_on()) {
    found.go_on_from(trusting.settled.result.rotations, odometry, rules,
                     ", from an answer that trusts odometry,");
  }
  if (goes_on()) {
    const auto closures =
        agreeing_closures(part.graph(), odometry, run.free_precision(), found.noise());
    found.go_on_from(run.agreed_by(closures), odometry, rules,
                     ", from closures that agree with one another,");
  }
  if (goes_on()) {
    const auto without = without_doubted_steps(run, part.graph(), part.series_of_part().label,
                                               found.rotations(), odometry, found.noise());
    if (without) {
      std::vector<bool> steps = odometry;
      for (std::size_t k = 0; k < steps.size(); ++k) steps[k] = steps[k] && !without->given_up[k];
      found.go_on_from(without->rotations, steps, rules,
                       ", without steps that many closures contradict,");
    }
  }
  Approach best = found.result();
  best.grown = trusting.grown ? trusting.grown : grown_freely;
  return best;
}

}  // namespace detail

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <utility>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/votes.hpp>
#include <rotavg/solve/status.hpp>

namespace rotavg {

/// Rotations that many measurements agree on, from where a loss finds the rest.
struct Consensus {
  Rotations rotations;
  double noise = 0.0;  ///< estimated standard deviation of the noise angle, radians
  Index moved = 0;     ///< nodes that votes have moved, each as often as it was
};

/// From rotations many of which may still be wrong:
///
/// 1. The noise is estimated from the residuals (noise_scale). While too few of these are small for
///    that, the loss cauchy is minimised, at first with so wide a scale that it has few local
///    minima, then with half of it, and so on.
/// 2. Nodes that a few wrong edges hold in the wrong place are moved to where most of their
///    neighbours would have them (take_votes). If they are many, others can vote better after the
///    loss has settled, and do, up to four times in all.
///
/// @param run that judges edges in any way; from 2. on, and when this returns, each in its own
/// units
/// @param graph that it runs on
/// @param R world_from_i
inline Consensus find_consensus(RobustRun& run, const MeasurementGraph& graph, Rotations R) {
  constexpr double wide_scale = 0.25;
  constexpr int most_halvings = 5, most_rounds = 4;
  constexpr double most_times = 2.0;  // nodes that were met exactly, and move, look like noise
  constexpr double patient_gain = 1e-5, brief_gain = 1e-4, many = 0.25;
  constexpr int patient_limit = 200, brief_limit = 10;
  const auto go_on = [&] { return run.ended() == Status::not_run; };
  const auto noise_at = [&](const Rotations& rotations) { return run.noise_at(rotations); };
  const auto settle = [&](double scale, double gain, int limit) {
    R = run.reweighted(R, {Loss::cauchy, scale}, gain, limit).rotations;
  };

  // 1.
  double noise = noise_at(R), scale = wide_scale;
  for (int k = 0; noise > most_noise && k < most_halvings && go_on(); ++k, scale *= 0.5) {
    settle(scale, patient_gain, patient_limit);
    noise = noise_at(R);
  }
  if (noise > most_noise) noise = noise_among_random(run.series_residuals_at(R));
  noise = std::min(noise, most_noise);

  // 2.
  run.judge_in_own_units();
  Consensus consensus;
  for (int k = 0; k < most_rounds && go_on(); ++k) {
    const Index moved =
        take_votes(graph, run.given(), run.judged_by(),
                   {Loss::geman_mcclure, outlier_noises * noise}, R, run.keep_going());
    consensus.moved += moved;
    if (moved > 0) {
      const double now = noise_at(R);
      noise = now < most_noise ? std::min(now, most_times * noise) : most_noise;
    }
    if (moved <= many * graph.num_nodes()) break;
    settle(noise, brief_gain, brief_limit);
    noise = std::min(most_noise, noise_at(R));
  }
  consensus.noise = noise;
  consensus.rotations = std::move(R);
  return consensus;
}

}  // namespace rotavg

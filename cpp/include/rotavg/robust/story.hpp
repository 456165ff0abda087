#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/part_votes.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/votes.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// An answer that a start has led to.
struct Story {
  std::string start;  ///< in words
  Rotations rotations;
  double noise = 0.0;     ///< radians
  std::vector<double> x;  ///< squared residuals (m,) in units of the noise, the same for all
};

/// A start, polished: a few reweightings, at first with so wide a scale that the edges of a tree do
/// not stay met exactly, which would pass for little noise; votes of the nodes, in which their
/// strongest edges count, and of the sides of cuts.
///
/// @param noise to begin with, radians
/// @param voices (m,) of the edges where nodes vote
/// @param loss_noises the scale of the loss in units of the noise
/// @param is_met asked of the rotations on the way: whether they have come to an answer that is
///        known, from where on nothing new is to be learnt
/// @returns nothing if they have
template <typename IsMet>
std::optional<Story> polished(RobustRun& run, const MeasurementGraph& graph,
                              const std::vector<double>& voices, double loss_noises, double noise,
                              std::string start, Rotations R, const IsMet& is_met) {
  constexpr double wide_noises = 3.0;
  constexpr double brief_gain = 1e-3, gain = 1e-4;
  constexpr int brief_limit = 8, limit = 20, most_rounds = 3;
  const auto noise_now = [&] { return std::min(most_noise, run.noise_at(R)); };
  R = run.reweighted(R, {Loss::cauchy, wide_noises * noise}, brief_gain, brief_limit).rotations;
  if (is_met(R)) return {};
  noise = noise_now();
  take_votes(graph, voices, run.precision(), {Loss::geman_mcclure, outlier_noises * noise}, R,
             run.keep_going());
  R = run.reweighted(R, {Loss::cauchy, wide_noises * noise}, brief_gain, brief_limit).rotations;
  if (is_met(R)) return {};
  noise = noise_now();
  R = run.reweighted(R, {Loss::cauchy, loss_noises * noise}, gain, limit).rotations;
  for (int k = 0; k < most_rounds; ++k) {
    noise = noise_now();
    if (take_part_votes(graph, run.precision(), run.squared_residuals_at(R), outlier_noises * noise,
                        R) == 0) {
      break;
    }
    R = run.reweighted(R, {Loss::cauchy, loss_noises * noise}, gain, brief_limit).rotations;
  }
  Story story;
  story.start = std::move(start);
  story.noise = noise_now();
  story.rotations = std::move(R);
  return story;
}

/// Whether an answer with so little noise is more than a tree that meets itself: n - 1 edges can be
/// met exactly by any answer, and a noise that they alone bear out is none. It takes further edges,
/// which close cycles.
///
/// @param x squared residuals (m,) in units of the noise
inline bool closes_cycles(const std::vector<double>& x, Index num_nodes) {
  constexpr double met_up_to = 9.0, further = 0.2, few = 3.0;
  const double tree = num_nodes - 1.0;
  const auto met = std::count_if(x.begin(), x.end(), [](double x_k) { return x_k <= met_up_to; });
  return static_cast<double>(met) >= tree + std::max(few, further * tree);
}

}  // namespace rotavg

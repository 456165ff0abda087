#pragma once

#include <utility>
#include <vector>

#include <rotavg/robust/consensus.hpp>
#include <rotavg/robust/default_scale.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/tails.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Where a loss has settled, at the scale that goes with the noise.
struct Settling {
  RobustLoss loss;
  double noise = 0.0;      ///< radians
  IterationResult result;  ///< its trace begins where the loss is at this scale
};

namespace detail {

/// An iteration that lowers the objective by a smaller part is the last.
constexpr double settled_gain = 1e-5;
constexpr int most_reweightings = 500;

}  // namespace detail

/// The loss by reweighting, of a bounded one by graduated non-convexity first if asked for, at a
/// scale that was given or that goes with the noise.
///
/// Where l1 has not come far, as on large graphs, the noise was taken for more than it is. So it is
/// looked at again where the loss has settled roughly, and if it is less than half the scale falls
/// with it, unless it was given. (Where few series of edges are checked, a loss that bends off
/// meets many exactly, which is no sign of less noise: there those count that no tree can meet.)
///
/// If the objective was lower at an earlier answer, it goes on from there; but not of huber and l1,
/// which never stop growing as fast as r: there a lower objective is the pull of the outliers.
///
/// @param asked its scale is zero where it goes with the noise
/// @param freedom Series::freedom
/// @param earlier answers
/// @param limit of the reweightings, before and after the noise is looked at again, and from an
///        earlier answer
inline Settling settle(RobustRun& run, const RobustLoss& asked, double freedom,
                       const Consensus& consensus, const std::vector<Rotations>& earlier,
                       bool graduates, int limit) {
  constexpr double rough_gain = 1e-3, much_less = 0.5, nearly_all = 0.9;
  Settling settled;
  RobustLoss& loss = settled.loss;
  double& noise = settled.noise;
  IterationResult& result = settled.result;
  noise = consensus.noise;
  loss.kind = asked.kind == Loss::automatic ? Loss::cauchy : asked.kind;
  loss.scale = asked.scale == 0.0 ? default_scale(loss.kind, freedom) * noise : asked.scale;
  const Rotations R = graduates ? run.graduated(consensus.rotations, loss) : consensus.rotations;
  result = run.reweighted(R, loss, rough_gain, limit);
  const double noise_now = freedom > nearly_all ? run.noise_at(result.rotations)
                                                : run.noise_off_tree_at(result.rotations);
  const bool less = noise_now < much_less * noise, rescales = less && asked.scale == 0.0;
  if (rescales) loss.scale *= noise_now / noise;
  if (less) noise = noise_now;
  IterationResult rest = run.reweighted(result.rotations, loss, detail::settled_gain, limit);
  if (rescales) {
    result = std::move(rest);
  } else {
    append(result, std::move(rest));
  }
  const bool redescends = loss.kind != Loss::huber && loss.kind != Loss::l1;
  for (const Rotations& other : earlier) {
    if (!redescends || !(run.objective_at(other, loss) < result.objective)) continue;
    IterationResult second = run.reweighted(other, loss, detail::settled_gain, limit);
    if (second.objective < result.objective) result = std::move(second);
  }
  return settled;
}

/// Where the noise is like a normal one in all directions, as of sensors, a loss that bends off
/// late loses less than one that heavy tails ask for. It shows at rotations that a blunt loss
/// leaves: a sharp one meets many measurements exactly, whose noise then seems to have heavy tails.
///
/// @param space Tails::space
/// @param loss, result where the automatic loss has settled; of normal noise receive that of Geman
///        and McClure at seven standard deviations, and where it settles
inline void settle_on_normal_noise(RobustRun& run, int space, double noise, RobustLoss& loss,
                                   IterationResult& result) {
  constexpr double blunt = 7.0, rough_gain = 1e-3;
  constexpr int brief_limit = 30;
  constexpr std::size_t few = 30;
  if (noise <= least_noise || noise >= most_noise) return;
  const double scale = blunt * noise / noise_per_axis(space);
  const IterationResult bluntly =
      run.reweighted(result.rotations, {Loss::cauchy, scale}, rough_gain, brief_limit);
  if (run.ended() != Status::not_run) return;
  const std::vector<double> x = run.series_residuals_at(bluntly.rotations);
  if (x.size() < few || !residual_tails(x, noise, space).are_normal()) return;
  loss = {Loss::geman_mcclure, scale};
  result = run.reweighted(bluntly.rotations, loss, detail::settled_gain, detail::most_reweightings);
}

}  // namespace rotavg

#pragma once

#include <optional>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/alternative.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

struct RobustOptions {
  Loss loss = Loss::automatic;
  /// c of RobustLoss, radians; zero: a multiple of the noise, which is estimated from the
  /// residuals.
  double scale = 0.0;
  /// Edges with so many short cycles or more, each of which misses the identity by more than this
  /// angle, are left out from the start; zero: none are.
  double cycle_threshold = 0.0;
  int min_cycles = 3;
  WeightKind weight_kind = WeightKind::automatic;
  EdgeKnowledge known;
  bool priors = true;  ///< whether the loss is that of absolute priors and gravity, too
  /// Whether the start is where this loss has ended before, on nearly the same problem: then
  /// neither l1 nor graduated non-convexity goes before the reweightings; votes do.
  bool continues = false;
};

/// What a robust loss has made of absolute priors, or of gravity.
struct PriorVerdicts {
  /// Estimated standard deviation of their angle, radians: of a prior with the median weight.
  double noise = 0.0;
  double threshold = 0.0;        ///< of outliers of that weight, radians: 3 times the noise
  std::vector<double> weights;   ///< given weight times robust weight, in the order of the nodes
  std::vector<bool> is_outlier;  ///< in the same order
};

/// The weighted least-squares solution that the reweighting ended with: `objective`,
/// `gradient_norm` and the certificate are those of the graph with `edge_weights`.
struct RobustSolution : Solution {
  RobustLoss loss;     ///< with the scale that was used
  double noise = 0.0;  ///< estimated standard deviation of the noise angle, radians; from 1e-4 on
  /// False where it would be half a radian or more: too few edges agree to tell it from errors.
  bool noise_shows = true;
  /// Of outliers, radians (thresholds.hpp): 3 times the noise, up to 10 times where it has heavy
  /// tails, and no less than a scale within which at least half of the weight is left; of Loss::tls
  /// the scale; pi with Loss::l2, which has none.
  double threshold = 0.0;
  double robust_objective = 0.0;     ///< 2 sum w rho(r^2), with priors before they are met
  std::vector<double> edge_weights;  ///< (m,) given weight times robust weight
  /// (m,) factors by which the scale, the noise and the threshold of an edge differ from those
  /// above; infinite for trusted ones
  std::vector<double> edge_scales;
  /// (m,) odometry that the loss has favoured (EdgeKnowledge::odometry): its scale, though not its
  /// noise and threshold, is larger by the root of closures_a_step. Empty where none was.
  std::vector<bool> favoured;
  EdgeVerdicts verdicts;
  PriorVerdicts absolute, gravity;  ///< empty without priors
  /// Edges that were kept and within the threshold, theirs and that of the priors, and that lie
  /// beyond twice as much once the priors are met: a prior is wrong, or one of these edges.
  Index num_strained = 0;
  Index moved_by_votes = 0;
  /// Other answers that the evidence does not rule out (find_stories); of the loss automatic alone.
  std::vector<Alternative> alternatives;
};

/// Finds rotations that fit most measurements, whatever the others say, and what it thinks of each.
///
/// Bridges, which no cycle checks, are left aside until step 7, and met exactly; edges that are
/// left out, until then too.
///
/// 1. Least squares, roughly, and from there the loss l1: robust and nearly convex, so that the
///    start matters little. Every edge has one voice so far, unless weights are frequencies.
/// 2. The noise is estimated from its residuals (noise_scale), and
/// 3. nodes that a few wrong edges hold in the wrong place are moved to where most of their
///    neighbours would have them, by find_consensus.
/// 4. The loss, by reweighting; of a bounded one by graduated non-convexity first. Where it has
///    settled roughly the noise is looked at again, and if it is less than half of what step 2 said
///    the scale falls with it (settle). If the objective was lower anywhere before (but of huber
///    and l1), it goes on from there. The trace is that of this stage, from where the loss is at
///    its last scale: its objective never rises.
///    With trusted edges up to four ways are tried, of edges that differ in precision up to three
///    where hardly any closes a cycle, and two where they are few and many contradict
///    (best_approach); the last begins near by, without l1 and graduated non-convexity. The answer
///    with the least objective goes on.
/// 5. Where many strong edges contradict, the loss automatic compares what it has found with where
///    other starts lead (find_stories), and goes on from there if they speak for it.
/// 6. Where the noise is normal it goes on with a blunt loss (settle_on_normal_noise).
/// 7. The weights are held, and the weighted problem is solved and certified. What is proved is
///    that no rotations have a smaller weighted sum of squares, not that no others have a smaller
///    robust objective or better weights.
///
/// @param start an initial value to use instead of step 1's least squares; with one, step 5 is left
///        out
/// @throws std::invalid_argument for an option out of range, knowledge of the edges that does not
///         fit the graph, or if `start` does not hold a rotation for each node
ROTAVG_INLINE RobustSolution solve_robust(const MeasurementGraph& graph,
                                          const SolveOptions& options = {},
                                          const RobustOptions& robust = {},
                                          std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/robust/solve_robust_impl.hpp>
#endif

#pragma once

#include <optional>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
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
  /// Edges with three or more short cycles, each of which misses the identity by more than this
  /// angle, are left out from the start; zero: none are.
  double cycle_threshold = 0.0;
};

/// The weighted least-squares solution that the reweighting ended with: `objective`,
/// `gradient_norm` and the certificate are those of the graph with `edge_weights`.
struct RobustSolution : Solution {
  RobustLoss loss;                   ///< with the scale that was used
  double noise = 0.0;                ///< estimated standard deviation of the noise angle, radians
  double threshold = 0.0;            ///< of outliers, radians; pi with Loss::l2, which has none
  double robust_objective = 0.0;     ///< 2 sum w rho(r^2) at `rotations`
  std::vector<double> edge_weights;  ///< (m,) given weight times robust weight
  EdgeVerdicts verdicts;
  Index moved_by_votes = 0;
};

/// Finds rotations that fit most measurements, whatever the others say, and what it thinks of each.
///
/// 1. Least squares, roughly, and from there the loss l1: robust and nearly convex, so that the
///    start matters little.
/// 2. The noise is estimated from its residuals (noise_scale), and
/// 3. nodes that a few wrong edges hold in the wrong place are moved to where most of their
///    neighbours would have them, by find_consensus.
/// 4. The loss, by reweighting; of a bounded one by graduated non-convexity first. The trace is
///    that of this stage, from where the loss is at its scale: its objective never rises.
/// 5. The weights are held, and the weighted problem is solved and certified. What is proved is
///    that no rotations have a smaller weighted sum of squares, not that no others have a smaller
///    robust objective or better weights.
///
/// @param start an initial value to use instead of step 1's least squares
/// @throws std::invalid_argument for an option out of range, or if `start` does not hold a rotation
///         for each node
ROTAVG_INLINE RobustSolution solve_robust(const MeasurementGraph& graph,
                                          const SolveOptions& options = {},
                                          const RobustOptions& robust = {},
                                          std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/robust/solve_robust_impl.hpp>
#endif

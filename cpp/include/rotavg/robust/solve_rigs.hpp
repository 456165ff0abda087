#pragma once

#include <optional>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/rig_estimate.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Finds the rotations of sensors in their rigs, together with those of the frames: R_i = Q_f C_s,
/// with C_s shared by all frames.
///
/// 1. Images of unknown sensors as plain nodes are solved for, with a robust loss if there is one.
///    (This is a relaxation, so that its certificate bounds the joint problem from below.)
/// 2. C_s is the median of what the frames say (sensors_from_images).
/// 3. From there frames and sensors descend together (refine_shared), again and again with the
///    robust weights that they make, until C rests. (Where only rigs join parts of the graph, the
///    frames are solved for with C held first, from random C, too, where the frames are few.) C
///    ends at a stationary point, which need not be the global optimum.
///
/// @param priors what else is known; its rigs do not count
/// @param options its callback is not called
/// @param robust none: least squares
/// @param start an initial value of the images, world_from_i
/// @throws InvalidPrior as RigLayout and GroundedGraph, and for a fixed rotation of a node whose
///         sensor is to be estimated
/// @throws std::invalid_argument as solve()
ROTAVG_INLINE RigEstimate estimate_rigs(const MeasurementGraph& graph, const Rigs& rigs,
                                        const Priors& priors = {}, const SolveOptions& options = {},
                                        const std::optional<RobustOptions>& robust = std::nullopt,
                                        std::optional<Rotations> start = std::nullopt);

/// The solution with the sensors held where they were found.
struct RigSolution : RobustSolution {
  RigEstimate rigs;
};

/// estimate_rigs(), then solve_robust() with C held: what is certified is that no frames fit better
/// with these sensors. RigEstimate::lower_bound tells how much other sensors could gain at most.
/// @param robust none: least squares, and only what Solution has is told
/// @throws InvalidPrior, std::invalid_argument as estimate_rigs()
ROTAVG_INLINE RigSolution solve_rigs(const MeasurementGraph& graph, const Rigs& rigs,
                                     const Priors& priors = {}, const SolveOptions& options = {},
                                     const std::optional<RobustOptions>& robust = std::nullopt,
                                     std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/robust/solve_rigs_impl.hpp>
#endif

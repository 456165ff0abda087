#pragma once

#include <optional>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

class GroundedGraph;

/// solve_robust() with priors: the weights of the measurements come from a robust solution without
/// what holds the world. With these, absolute priors and gravity get robust weights as well
/// (RobustPriors), and all are held in the problem that is solved and certified.
///
/// @param start an initial value to use instead of the first least squares, world_from_i of the
///        given nodes
/// @throws std::invalid_argument as solve_robust() of a graph
ROTAVG_INLINE RobustSolution solve_robust(const GroundedGraph& problem,
                                          const SolveOptions& options = {},
                                          const RobustOptions& robust = {},
                                          std::optional<Rotations> start = std::nullopt);

/// The same for measurements and priors as they come.
/// @throws InvalidPrior, std::invalid_argument as GroundedGraph and solve_robust()
ROTAVG_INLINE RobustSolution solve_robust(const MeasurementGraph& graph, const Priors& priors,
                                          const SolveOptions& options = {},
                                          const RobustOptions& robust = {},
                                          std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/robust/solve_robust_with_priors_impl.hpp>
#endif

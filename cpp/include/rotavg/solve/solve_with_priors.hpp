#pragma once

#include <optional>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

class GroundedGraph;

/// Finds the rotations that fit measurements and priors best, and certifies them: what is proved is
/// that no rotations have a smaller objective, priors included. They are in the world of the
/// priors; in a component that no prior holds, the first variable has R = I; where gravity alone
/// holds a part, its heading is such that its first variable is as near to I as can be.
///
/// The measurements are solved without what holds the world first, then turned to meet it, and
/// solved with it from there. A callback is told of both stages, one after the other: of the first
/// the objective without what holds the world.
///
/// @param start an initial value, world_from_i of the given nodes
/// @param start_is_solution whether it is one already, so that none is needed without the world
/// @returns figures of the problem with the priors; the constant of gravity's edges is in none
/// @throws std::invalid_argument as solve() of a graph
ROTAVG_INLINE Solution solve(const GroundedGraph& problem, const SolveOptions& options = {},
                             std::optional<Rotations> start = std::nullopt,
                             bool start_is_solution = false);

/// The same for measurements and priors as they come.
/// @throws InvalidPrior, std::invalid_argument as GroundedGraph and solve()
ROTAVG_INLINE Solution solve(const MeasurementGraph& graph, const Priors& priors,
                             const SolveOptions& options = {},
                             std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/solve/solve_with_priors_impl.hpp>
#endif

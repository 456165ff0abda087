#pragma once

#include <optional>
#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Finds the rotations that fit measurements with full covariances best, and certifies them. In
/// every component the first node has R = I.
///
/// The method is that of the descent: `automatic` solves the scalar problem (AnisotropicGraph::
/// scalar) first and goes on from there by three sweeps of bcd and newton, on dense graphs by sum.
/// If the answer is refuted, there is a second run from the chordal value. The others start from
/// options.init, but for staircase and bcdsr, which solve the scalar problem, and then `automatic`
/// goes on.
///
/// @param start an initial value to use instead (a warm start)
/// @throws std::invalid_argument as solve() of a MeasurementGraph
ROTAVG_INLINE Solution solve(const AnisotropicGraph& graph, const SolveOptions& options = {},
                             std::optional<Rotations> start = std::nullopt);

/// The same with priors, from a solution without covariances. What rides turns the precisions with
/// it, and a prior of the weight w has the precision w I. (No gravity.)
///
/// @param precisions (m,) of the edges of problem.given()
/// @param start one rotation for each given node
/// @throws std::invalid_argument also for gravity
ROTAVG_INLINE Solution solve(const GroundedGraph& problem, const std::vector<Matrix3>& precisions,
                             const SolveOptions& options, const Rotations& start);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/anisotropic/solve_impl.hpp>
#endif

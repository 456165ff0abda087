#pragma once

#include <optional>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Finds the rotations that fit measurements with full covariances best, and certifies them. In
/// every component the first node has R = I.
///
/// The method is that of the descent: `automatic` solves the scalar problem (AnisotropicGraph::
/// scalar) first and goes on from there by three sweeps of bcd and newton, on dense graphs by sum.
/// If the answer is refuted, there is a second run from the chordal value, and if that is, too, the
/// staircase of a problem with blocks that bounds this one from below (anisotropic/minorant.hpp).
/// The others start from options.init, staircase with that climb; but bcdsr solves the scalar
/// problem, and then `automatic` goes on.
///
/// @param start an initial value to use instead (a warm start)
/// @throws std::invalid_argument as solve() of a MeasurementGraph
ROTAVG_INLINE Solution solve(const AnisotropicGraph& graph, const SolveOptions& options = {},
                             std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/anisotropic/solve_impl.hpp>
#endif

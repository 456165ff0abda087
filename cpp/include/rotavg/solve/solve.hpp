#pragma once

#include <optional>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Finds the rotations that fit the measurements best, and certifies them. In every component the
/// first node has R = I.
///
/// With Method::automatic, an answer that has converged but is refuted by its certificate is not
/// the end: with Initialization::automatic (and no `start`), a second answer is computed from the
/// chordal initial value; if that is refuted, too, the Riemannian staircase is climbed. The best
/// rotations are returned, with the best bound.
///
/// @param start an initial value to use instead of options.init (a warm start)
/// @throws std::invalid_argument unless `start` holds a rotation for each node, for a tolerance or
///         limit that is negative or not a number, and if bcdsr's dense matrix does not fit in
///         memory
ROTAVG_INLINE Solution solve(const MeasurementGraph& graph, const SolveOptions& options = {},
                             std::optional<Rotations> start = std::nullopt);

}  // namespace rotavg

#pragma GCC diagnostic pop

#ifndef ROTAVG_COMPILED
#include <rotavg/solve/solve_impl.hpp>
#endif

#pragma once

#include <functional>
#include <new>
#include <optional>

#include <rotavg/graph/coarsening.hpp>
#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/so3/loso_quaternion.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// What multilevel_init() shares among its levels.
struct Levels {
  double half_edges_left;  ///< that coarser levels may have
  int num_threads;
  std::function<bool()> keep_going;

  bool goes_on() const { return !keep_going || keep_going(); }
};

/// The rotations of a level: what the coarser ones say, and two sweeps, there and back.
template <typename Rows>
std::optional<Quaternions> rotations_of_level(const Rows& rows, Levels& levels) {
  constexpr Index nodes_between_questions = 4096;
  const Index n = rows.num_nodes();
  std::optional<Quaternions> q;
  {
    if (!levels.goes_on()) return std::nullopt;
    const NodeGroups groups = heavy_edge_matching(rows);
    if (groups.count == 0) return groups.group_from_node;  // no edges are left
    if (!levels.goes_on()) return std::nullopt;
    const HalfEdgeRows coarse = coarse_rows(rows, groups, levels.num_threads);
    levels.half_edges_left -= 2.0 * coarse.num_edges();
    if (levels.half_edges_left < 0.0) return std::nullopt;
    q = rotations_of_level(coarse, levels);
    if (!q) return std::nullopt;
    q = groups.nodes_from(*q);
  }
  for (Index k = 0; k < 2 * n; ++k) {
    const Index l = k < n ? k : 2 * n - 1 - k;
    if (rows.row(l).size() > 0) (*q)[l] = loso(davenport_matrix(rows, *q, l), (*q)[l]);
    if (k % nodes_between_questions == 0 && !levels.goes_on()) return std::nullopt;
  }
  return q;
}

}  // namespace detail

/// The multilevel initial value: the graph is made coarser again and again, as nodes that are
/// joined by the heaviest edges ride on one another, until nothing is left to join. The way back
/// gives every level the rotations of the coarser one and two sweeps of block coordinate descent.
/// Each level thus corrects what it can see, and noise does not add up along paths. Exact without
/// noise; it takes as long as some sweeps, and the memory of the rows of all levels.
///
/// Lattices, trajectories and cities shrink from level to level. Of random graphs the edges stay as
/// many as they are, as no two of them join the same groups: there is no result (and no need of
/// one: their paths are short).
///
/// @param keep_going asked before every level is made and every few milliseconds of the sweeps;
///        where it says false, there is no result, nor where there is no memory for it
inline std::optional<Rotations> multilevel_init(const MeasurementGraph& graph, int num_threads = 1,
                                                const std::function<bool()>& keep_going = {}) try {
  constexpr double levels_at_most = 3.0;  // as large as the graph itself, all taken together
  detail::Levels levels{levels_at_most * 2.0 * graph.num_edges(), num_threads, keep_going};
  const auto q = detail::rotations_of_level(graph, levels);
  if (!q) return std::nullopt;
  return to_rotations(*q);
} catch (const std::bad_alloc&) {
  return std::nullopt;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

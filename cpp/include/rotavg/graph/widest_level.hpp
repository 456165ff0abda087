#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The number of nodes in the widest level of breadth-first searches in a component. It is small on
/// trajectories, lattices and cities, where every level is a separator, and a fair share of all
/// nodes on random graphs, which have no small ones; but on trees with many branches, too.
///
/// @param skipped so many of the component's first nodes are as if they were not there, and so are
///        hubs, with many times as many edges as others: a few of them are separators themselves
inline Index widest_level(const MeasurementGraph& graph, const Components& components,
                          Index component, Index skipped = 0) {
  constexpr double many = 10.0, at_least = 64.0;  // edges of a hub: times the mean, and so many
  const std::vector<Index>& nodes = components.nodes[component];
  double ends = 0.0;
  for (const Index i : nodes) ends += graph.row(i).size();
  const double hub = std::max(at_least, many * ends / static_cast<double>(nodes.size()));
  std::vector<char> visited(nodes.size(), 0);
  for (std::size_t a = 0; a < nodes.size(); ++a) {
    visited[a] = static_cast<Index>(a) < skipped || graph.row(nodes[a]).size() >= hub;
  }
  std::size_t widest = 0;
  std::vector<Index> level, next;
  for (std::size_t a = 0; a < nodes.size(); ++a) {
    if (visited[a]) continue;
    visited[a] = 1;
    level.assign(1, nodes[a]);
    while (!level.empty()) {
      widest = std::max(widest, level.size());
      next.clear();
      for (const Index i : level) {
        for (const HalfEdge& h : graph.row(i)) {
          char& is_visited = visited[components.row_in_component[h.node]];
          if (!is_visited) next.push_back(h.node);
          is_visited = 1;
        }
      }
      std::swap(level, next);
    }
  }
  return static_cast<Index>(widest);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

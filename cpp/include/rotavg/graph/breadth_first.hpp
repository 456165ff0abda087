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

/// A breadth-first forest: every node's parent on a shortest path to the first node of its
/// component.
struct BreadthFirstForest {
  std::vector<Index> order;      ///< all nodes, parents before children
  std::vector<Index> parent;     ///< (n,) parent of each node, -1 for a root
  std::vector<Index> depth;      ///< (n,) edges between a node and its root
  std::vector<Index> tree_edge;  ///< (n,) the edge to the parent, -1 for a root
};

/// @param left_out (m,) edges that are as if they were not there; empty for none
inline BreadthFirstForest breadth_first_forest(const MeasurementGraph& graph,
                                               const std::vector<bool>& left_out = {}) {
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  BreadthFirstForest forest;
  forest.order.reserve(n);
  forest.parent.assign(n, -1);
  forest.depth.assign(n, -1);
  forest.tree_edge.assign(n, -1);
  for (Index root = 0; root < graph.num_nodes(); ++root) {
    if (forest.depth[root] >= 0) continue;
    forest.depth[root] = 0;
    std::size_t next = forest.order.size();
    forest.order.push_back(root);
    for (; next < forest.order.size(); ++next) {
      const Index i = forest.order[next];
      if (forest.order.size() == n) return forest;  // on dense graphs, long before the last row
      for (const HalfEdge& h : graph.row(i)) {
        const Index j = h.node;
        if (forest.depth[j] >= 0 || (!left_out.empty() && left_out[h.edge()])) continue;
        forest.depth[j] = forest.depth[i] + 1;
        forest.parent[j] = i;
        forest.tree_edge[j] = h.edge();
        forest.order.push_back(j);
      }
    }
  }
  return forest;
}

/// The number of edges of the cycle that an edge closes with the paths of the forest between its
/// ends; 1 for an edge of the forest itself.
inline Index fundamental_cycle_length(const MeasurementGraph& graph,
                                      const BreadthFirstForest& forest, Index edge) {
  Index i = graph.edges()[edge].i;
  Index j = graph.edges()[edge].j;
  if (forest.tree_edge[i] == edge || forest.tree_edge[j] == edge) return 1;
  Index length = 1;
  while (i != j) {  // climb to the lowest common ancestor
    Index& deeper = forest.depth[i] > forest.depth[j] ? i : j;
    deeper = forest.parent[deeper];
    ++length;
  }
  return length;
}

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

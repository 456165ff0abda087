#pragma once

#include <cstddef>
#include <vector>

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

}  // namespace rotavg

#pragma GCC diagnostic pop

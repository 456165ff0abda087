#pragma once

#include <algorithm>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Which edges (m,) are bridges: without them a component falls apart, and no cycle checks them,
/// whatever they say. Tarjan's algorithm (1974), without recursion; of parallel edges none is one.
inline std::vector<bool> bridges(const MeasurementGraph& graph) {
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  struct Visit {
    Index node;
    Index edge;              // by which it was entered, -1 for a root
    HalfEdges::Iterator at;  // the next to look at
  };
  std::vector<bool> is_bridge(graph.edges().size(), false);
  std::vector<Index> order(n, -1), lowest(n, -1);
  std::vector<Visit> stack;
  Index visited = 0;
  const auto enter = [&](Index node, Index edge) {
    order[node] = lowest[node] = visited++;
    stack.push_back({node, edge, graph.row(node).begin()});
  };
  for (Index root = 0; root < graph.num_nodes(); ++root) {
    if (order[root] >= 0) continue;
    enter(root, -1);
    while (!stack.empty()) {
      Visit& visit = stack.back();
      if (visit.at != graph.row(visit.node).end()) {
        const HalfEdge h = *visit.at;
        ++visit.at;
        if (h.edge() == visit.edge) continue;
        if (order[h.node] < 0) {
          enter(h.node, h.edge());
        } else {
          lowest[visit.node] = std::min(lowest[visit.node], order[h.node]);
        }
        continue;
      }
      const Visit done = visit;
      stack.pop_back();
      if (stack.empty()) continue;
      const Index parent = stack.back().node;
      lowest[parent] = std::min(lowest[parent], lowest[done.node]);
      is_bridge[done.edge] = lowest[done.node] > order[parent];
    }
  }
  return is_bridge;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

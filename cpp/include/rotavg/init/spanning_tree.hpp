#pragma once

#include <functional>
#include <queue>
#include <tuple>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/edge_support.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The spanning-tree start (Enqvist, Kahl and Olsson 2011): products of the measurements along the
/// spanning tree whose edges have the largest support, R = I at the first node of every component.
/// Their support comes from the images; here it is edge_support(), from the weights and the
/// triangles, which keeps outliers out of the tree. Exact without noise.
///
/// Prim's algorithm: the tree takes the best supported of the edges that leave it; among equals the
/// one that leaves it nearest to the root, then the first. Where there are no triangles and all
/// weights are equal, this is a tree of shortest paths.
inline Rotations spanning_tree_init(const MeasurementGraph& graph,
                                    const std::function<bool()>& keep_going = {}) {
  const std::vector<double> support = edge_support(graph, keep_going);
  Rotations R(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  std::vector<Index> depth(R.size(), -1);
  // Support, and then, as the largest comes first, minus the depth and minus the edge.
  using Candidate = std::tuple<double, Index, Index>;
  std::priority_queue<Candidate> leaving;
  for (Index root = 0; root < graph.num_nodes(); ++root) {
    if (depth[root] >= 0) continue;
    depth[root] = 0;
    for (Index newest = root; newest >= 0;) {
      for (const HalfEdge& h : graph.row(newest)) {
        if (depth[h.node] < 0) leaving.emplace(support[h.edge()], -depth[newest], -h.edge());
      }
      newest = -1;
      while (newest < 0 && !leaving.empty()) {
        const Edge& e = graph.edges()[-std::get<2>(leaving.top())];
        leaving.pop();
        if (depth[e.i] >= 0 && depth[e.j] >= 0) continue;
        newest = depth[e.i] < 0 ? e.i : e.j;
        const Index parent = depth[e.i] < 0 ? e.j : e.i;
        depth[newest] = depth[parent] + 1;
        R[newest] = along_edge(e, R[parent], newest);
      }
    }
  }
  return R;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

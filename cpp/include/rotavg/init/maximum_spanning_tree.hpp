#pragma once

#include <algorithm>
#include <functional>
#include <limits>
#include <queue>
#include <tuple>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The edges of the spanning tree, of every component, whose edges have the largest keys, in the
/// order in which it takes them from the component's first node.
///
/// Prim's algorithm: the tree takes the edge with the largest key of those that leave it; among
/// equals the one that leaves it nearest to the root, then the first. Where all keys are equal,
/// this is a tree of shortest paths.
///
/// @param key (m,) how good the edges are, no NaN
/// @param keep_going asked every few milliseconds; false stops, and the rest is missing
inline std::vector<Index> maximum_spanning_forest(const MeasurementGraph& graph,
                                                  const std::vector<double>& key,
                                                  const std::function<bool()>& keep_going = {}) {
  constexpr Index nodes_between_questions = 1024;
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  std::vector<Index> forest, depth(n, -1);
  forest.reserve(n);
  // The key, and then, as the largest comes first, minus the depth and minus the edge.
  using Candidate = std::tuple<double, Index, Index>;
  std::priority_queue<Candidate> leaving;
  // Of the edges by which a node can be reached only better ones than before need to wait.
  const Candidate none(-std::numeric_limits<double>::infinity(), std::numeric_limits<Index>::min(),
                       0);
  std::vector<Candidate> best(n, none);
  Index reached = 0;
  for (Index root = 0; root < graph.num_nodes(); ++root) {
    if (depth[root] >= 0) continue;
    depth[root] = 0;
    for (Index newest = root; newest >= 0;) {
      if (++reached % nodes_between_questions == 0 && keep_going && !keep_going()) return forest;
      for (const HalfEdge& h : graph.row(newest)) {
        if (depth[h.node] >= 0) continue;
        const Candidate candidate(key[h.edge()], -depth[newest], -h.edge());
        if (!(best[h.node] < candidate)) continue;
        best[h.node] = candidate;
        leaving.push(candidate);
      }
      newest = -1;
      while (newest < 0 && !leaving.empty()) {
        const Index k = -std::get<2>(leaving.top());
        leaving.pop();
        const Edge& e = graph.edges()[k];
        if (depth[e.i] >= 0 && depth[e.j] >= 0) continue;
        newest = depth[e.i] < 0 ? e.i : e.j;
        depth[newest] = depth[depth[e.i] < 0 ? e.j : e.i] + 1;
        forest.push_back(k);
      }
    }
  }
  return forest;
}

/// Products of the measurements along a spanning forest, R = I at the first node of every
/// component, and where it does not reach. Exact without noise.
/// @param forest as of maximum_spanning_forest
inline Rotations along_forest(const MeasurementGraph& graph, const std::vector<Index>& forest) {
  Rotations R(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  std::vector<bool> reached(R.size(), false);
  for (const Index k : forest) {
    const Edge& e = graph.edges()[k];
    if (!reached[e.i] && !reached[e.j]) reached[std::min(e.i, e.j)] = true;  // a root
    const Index newest = reached[e.i] ? e.j : e.i;
    R[newest] = along_edge(e, R[reached[e.i] ? e.i : e.j], newest);
    reached[newest] = true;
  }
  return R;
}

/// The same along maximum_spanning_forest().
inline Rotations along_spanning_tree(const MeasurementGraph& graph, const std::vector<double>& key,
                                     const std::function<bool()>& keep_going = {}) {
  return along_forest(graph, maximum_spanning_forest(graph, key, keep_going));
}

/// The maximum-spanning-tree start: along the tree with the largest weights. Where weights are
/// numbers of matches and no edge is wrong at random, it leaves out repeated structure: what only
/// looks alike shares fewer matches than what is seen twice. A single random edge of great weight
/// ruins it.
inline Rotations maximum_spanning_tree_init(const MeasurementGraph& graph,
                                            const std::function<bool()>& keep_going = {}) {
  std::vector<double> weights;
  weights.reserve(graph.edges().size());
  for (const Edge& e : graph.edges()) weights.push_back(e.weight);
  return along_spanning_tree(graph, weights, keep_going);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

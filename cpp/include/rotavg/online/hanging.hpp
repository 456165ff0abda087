#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/online/core.hpp>
#include <rotavg/online/growing_graph.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

// The trees that hang from the core or a ground, whose nodes meet their edges exactly.

/// base_from_j of the other end of an edge k at i, which it meets.
inline Quaternion ride(const GrowingGraph& graph, Index k, Index i, const Quaternion& base_from_i) {
  const OnlineEdge& e = graph.edge(k);
  const WeightedQuaternion other = e.i == i ? e.i_from_j : e.i_from_j.conjugate();
  return Quaternion(product(base_from_i, other)).normalized();
}

/// Calls f(j, edge) for every node j that hangs from i itself.
template <typename Function>
void for_each_hanging(const Core& core, Index i, Function&& f) {
  for (const GrowingGraph::End& end : core.graph().ends(i)) {
    const OnlineNode& node = core.node(end.node);
    if (node.kind == NodeKind::hanging && node.anchor_edge == end.edge && node.anchor == i) {
      f(end.node, end.edge);
    }
  }
}

/// A node, and all that hangs from it.
inline std::vector<Index> hanging_tree(const Core& core, Index j) {
  std::vector<Index> tree{j};
  for (std::size_t p = 0; p < tree.size(); ++p) {
    for_each_hanging(core, tree[p], [&](Index l, Index) { tree.push_back(l); });
  }
  return tree;
}

/// What hangs from a node of the core, or ground, rides on it from now on.
inline void hang_anew(Core& core, Index base) {
  std::vector<std::pair<Index, Quaternion>> stack{{base, Quaternion::Identity()}};
  while (!stack.empty()) {
    const auto at = stack.back();
    stack.pop_back();
    for_each_hanging(core, at.first, [&](Index j, Index edge) {
      OnlineNode& node = core.node(j);
      node.base = base;
      node.q = ride(core.graph(), edge, at.first, at.second);
      stack.emplace_back(j, node.q);
    });
  }
}

}  // namespace rotavg

#pragma once

#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The connected components of a graph, numbered in the order of their first nodes.
struct Components {
  std::vector<Index> label;  ///< (n,) component of each node
  std::vector<Index>
      row_in_component;  ///< (n,) place of each node among the nodes of its component
  std::vector<std::vector<Index>> nodes;  ///< the nodes of each component, rising

  Index size() const { return static_cast<Index>(nodes.size()); }
  /// The node that holds the gauge, R = I, in component c: its first.
  Index root(Index c) const { return nodes[c].front(); }
};

inline Components connected_components(const MeasurementGraph& graph) {
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  Components components;
  components.label.assign(n, -1);
  components.row_in_component.assign(n, 0);
  std::vector<Index> stack;
  Index unlabelled = graph.num_nodes();  // none are left on dense graphs long before the last row
  for (Index root = 0; root < graph.num_nodes(); ++root) {
    if (components.label[root] >= 0) continue;
    const Index c = components.size();
    components.nodes.emplace_back();
    components.label[root] = c;
    --unlabelled;
    stack.assign(1, root);
    while (!stack.empty() && unlabelled > 0) {
      const Index i = stack.back();
      stack.pop_back();
      for (const HalfEdge& h : graph.row(i)) {
        Index& label = components.label[h.node];
        if (label >= 0) continue;
        label = c;
        --unlabelled;
        stack.push_back(h.node);
      }
    }
  }
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    std::vector<Index>& nodes = components.nodes[components.label[i]];
    components.row_in_component[i] = static_cast<Index>(nodes.size());
    nodes.push_back(i);
  }
  return components;
}

/// One component as a graph of its own, its nodes in the same order.
inline MeasurementGraph component_graph(const MeasurementGraph& graph, const Components& components,
                                        Index component) {
  std::vector<RelativeQuaternion> measurements;
  std::vector<NodeId> nodes;
  for (const Index i : components.nodes[component]) {
    nodes.push_back(graph.nodes()[i]);
    for (const HalfEdge& h : graph.row(i)) {
      if (!h.is_i()) continue;
      const Edge e = graph.edges()[h.edge()];
      measurements.push_back({graph.nodes()[e.i], graph.nodes()[e.j], e.quaternion, e.weight});
    }
  }
  return MeasurementGraph(
      measurements.size(), [&](std::size_t k) { return measurements[k]; }, std::move(nodes));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

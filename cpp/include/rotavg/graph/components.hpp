#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/breadth_first.hpp>
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

/// The components whose trees a forest of the graph is made of.
inline Components connected_components(const BreadthFirstForest& forest) {
  const std::size_t n = forest.order.size();
  Components components;
  components.label.assign(n, -1);
  components.row_in_component.assign(n, 0);
  for (const Index i : forest.order) {
    const Index parent = forest.parent[i];
    components.label[i] = parent < 0 ? components.size() : components.label[parent];
    if (parent < 0) components.nodes.emplace_back();
  }
  for (Index i = 0; i < static_cast<Index>(n); ++i) {
    std::vector<Index>& nodes = components.nodes[components.label[i]];
    components.row_in_component[i] = static_cast<Index>(nodes.size());
    nodes.push_back(i);
  }
  return components;
}
inline Components connected_components(const MeasurementGraph& graph) {
  return connected_components(breadth_first_forest(graph));
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

#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The parts (n,) into which the nodes fall where only some edges (m,) hold, numbered in the order
/// of their first nodes.
inline std::vector<Index> parts_joined_by(const MeasurementGraph& graph,
                                          const std::vector<bool>& holds) {
  std::vector<Index> parent(static_cast<std::size_t>(graph.num_nodes()));
  std::iota(parent.begin(), parent.end(), 0);
  const auto find = [&](Index i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (!holds[k]) continue;
    const Index a = find(graph.edges()[k].i), b = find(graph.edges()[k].j);
    parent[a > b ? a : b] = a > b ? b : a;  // the first node stays the root
  }
  std::vector<Index> label(parent.size());
  Index parts = 0;
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    const Index root = find(i);
    label[i] = root == i ? parts++ : label[root];
  }
  return label;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

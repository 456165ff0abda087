#pragma once

#include <functional>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/edge_support.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The spanning-tree start (Enqvist, Kahl and Olsson 2011): products of the measurements along the
/// spanning tree whose edges have the largest support. Their support comes from the images; here it
/// is edge_support(), from the weights and the triangles, which keeps outliers out of the tree.
/// Exact without noise.
inline Rotations spanning_tree_init(const MeasurementGraph& graph,
                                    const std::function<bool()>& keep_going = {}) {
  return along_spanning_tree(graph, edge_support(graph, keep_going), keep_going);
}

}  // namespace rotavg

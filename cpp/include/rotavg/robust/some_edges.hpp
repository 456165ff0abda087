#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A graph of some of the edges alone, between all of the nodes.
/// @param edges of `graph`, in the order of the new one
/// @param weights of these edges
inline MeasurementGraph some_edges(const MeasurementGraph& graph, const std::vector<Index>& edges,
                                   const std::vector<double>& weights) {
  const auto measurement = [&](std::size_t k) -> RelativeQuaternion {
    const Edge e = graph.edges()[edges[k]];
    return {graph.nodes()[e.i], graph.nodes()[e.j], e.quaternion, weights[k]};
  };
  return {edges.size(), measurement, graph.nodes()};
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The graph of the edges that are no outliers, in their order and with the weights of `graph`. All
/// nodes are in it, so that rows stay the same; where outliers alone hold parts together (see
/// EdgeVerdicts::part) it falls into these, and the first node of each has the identity.
/// @throws std::invalid_argument unless there is one verdict for each edge, and if all are outliers
inline MeasurementGraph without_outliers(const MeasurementGraph& graph,
                                         const EdgeVerdicts& verdicts) {
  const auto& edges = graph.quaternion_edges();
  if (verdicts.edges.size() != edges.size()) {
    throw std::invalid_argument("found " + std::to_string(verdicts.edges.size()) +
                                " verdicts; expected " + std::to_string(edges.size()) +
                                ", one for each edge");
  }
  std::vector<std::size_t> kept;
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (!is_outlier(verdicts.edges[k])) kept.push_back(k);
  }
  const auto measurement = [&](std::size_t row) {
    const QuaternionEdge& e = edges[kept[row]];
    return RelativeQuaternion{graph.nodes()[e.i], graph.nodes()[e.j], e.i_from_j,
                              graph.weights()[kept[row]]};
  };
  return {kept.size(), measurement, graph.nodes()};
}

}  // namespace rotavg

#pragma GCC diagnostic pop

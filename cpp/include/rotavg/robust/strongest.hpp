#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/robust/neighbourhoods.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How many of its edges a camera trusts more than all others: of some forty, those with its
/// nearest neighbours.
constexpr int strongest_of_a_camera = 8;

/// For how many of its two ends (m,) an edge is among the strongest: 0, 1 or 2.
/// @param strength (m,) of the edges
/// @param count edges of every camera
inline std::vector<double> strongest(const MeasurementGraph& graph,
                                     const std::vector<double>& strength,
                                     int count = strongest_of_a_camera) {
  std::vector<double> ends(strength.size(), 0.0);
  std::vector<std::pair<double, Index>> row;
  for (Index l = 0; l < graph.num_nodes(); ++l) {
    row.clear();
    for (const HalfEdge& h : graph.row(l)) row.emplace_back(-strength[h.edge()], h.edge());
    const auto chosen =
        row.begin() + std::min(std::ptrdiff_t{count}, static_cast<std::ptrdiff_t>(row.size()));
    std::partial_sort(row.begin(), chosen, row.end());
    for (auto edge = row.begin(); edge != chosen; ++edge) ends[edge->second] += 1.0;
  }
  return ends;
}

/// The strength (m,) of edges, 0 to 1: how many of their strongest neighbours two cameras share
/// (Jarvis and Patrick 1973), where strength is at first the overlap of their neighbourhoods.
///
/// The weight of an edge has no say in it but through the overlap: it says how precise the edge is,
/// not how probable, and a wrong edge may well be said to be precise.
/// @param overlap (m,) of Neighbourhoods
inline std::vector<double> shared_strongest(const MeasurementGraph& graph,
                                            const Neighbourhoods& neighbourhoods,
                                            const std::vector<double>& overlap,
                                            int count = strongest_of_a_camera) {
  constexpr double others = 1e-6, tie_break = 1e-3;  // of those that share none, and as many
  std::vector<double> ends = strongest(graph, overlap, count);
  for (double& e : ends) e += others;
  std::vector<double> shared = neighbourhoods.overlap(ends);
  for (std::size_t k = 0; k < shared.size(); ++k) shared[k] += tie_break * overlap[k];
  return shared;
}

/// The edges (m,) that are among the strongest of an end, and all that join the parts into which a
/// component would fall without the others.
/// @param ends of strongest()
inline std::vector<bool> skeleton(const MeasurementGraph& graph, const std::vector<double>& ends) {
  std::vector<bool> chosen(ends.size());
  for (std::size_t k = 0; k < ends.size(); ++k) chosen[k] = ends[k] > 0.0;
  const std::vector<Index> part = parts_joined_by(graph, chosen);
  for (std::size_t k = 0; k < ends.size(); ++k) {
    const Edge& e = graph.edges()[k];
    chosen[k] = chosen[k] || part[e.i] != part[e.j];
  }
  return chosen;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

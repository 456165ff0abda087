#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/robust/neighbourhoods.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How many of its edges a camera trusts more than all others, at most: of some forty, those with
/// its nearest neighbours.
constexpr int most_strongest = 8;

/// The same among so many cameras and edges: a tenth of the cameras, as the nearest of nineteen are
/// not eight, and a third of the edges that each has on average, but four at least, as any one
/// may be wrong.
inline int num_strongest(Index cameras, Index edges, int most = most_strongest) {
  constexpr double of_cameras = 0.1, of_edges = 1.0 / 3.0;
  constexpr int least = 4;
  const double n = std::max<double>(cameras, 1.0);
  const double some = std::ceil(std::min(of_cameras * n, of_edges * 2.0 * edges / n));
  return static_cast<int>(std::min<double>(most, std::max<double>(least, some)));
}

/// For how many of its two ends (m,) an edge is among the strongest: 0, 1 or 2.
/// @param strength (m,) of the edges
/// @param most edges of every camera, in a large component (num_strongest)
inline std::vector<double> strongest(const MeasurementGraph& graph,
                                     const std::vector<double>& strength,
                                     int most = most_strongest) {
  const Components components = connected_components(graph);
  std::vector<Index> cameras(components.size(), 0), edges(components.size(), 0);
  for (const Index c : components.label) ++cameras[c];
  for (const Edge& e : graph.edges()) ++edges[components.label[e.i]];
  std::vector<double> ends(strength.size(), 0.0);
  std::vector<std::pair<double, Index>> row;
  for (Index l = 0; l < graph.num_nodes(); ++l) {
    row.clear();
    for (const HalfEdge& h : graph.row(l)) row.emplace_back(-strength[h.edge()], h.edge());
    const Index c = components.label[l];
    const std::ptrdiff_t count = num_strongest(cameras[c], edges[c], most);
    const auto chosen = row.begin() + std::min(count, static_cast<std::ptrdiff_t>(row.size()));
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
                                            int most = most_strongest) {
  constexpr double others = 1e-6, tie_break = 1e-3;  // of those that share none, and as many
  std::vector<double> ends = strongest(graph, overlap, most);
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

#pragma once

#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Where a node is along the odometry that reaches it.
struct Station {
  Index walk = -1;        ///< the first node of that odometry
  Index place = 0;        ///< steps from there
  double variance = 0.0;  ///< of the way, in units of the noise's
  Matrix3 walk_from_node = Matrix3::Identity();
};

/// The nodes along each walk, from one of its ends where it has any.
/// @param precision (m,), or empty: all 1
inline std::vector<Station> stations(const MeasurementGraph& graph,
                                     const std::vector<bool>& odometry,
                                     const std::vector<double>& precision) {
  const Index n = graph.num_nodes();
  std::vector<Index> degree(n, 0), waiting;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (!odometry[k]) continue;
    ++degree[graph.edges()[k].i];
    ++degree[graph.edges()[k].j];
  }
  std::vector<Station> at(n);
  const auto walk_from = [&](Index first) {
    if (at[first].walk >= 0) return;
    at[first].walk = first;
    waiting.assign(1, first);
    while (!waiting.empty()) {
      const Index i = waiting.back();
      waiting.pop_back();
      for (const HalfEdge& h : graph.row(i)) {
        if (!odometry[h.edge()] || at[h.node].walk >= 0) continue;
        const Edge& e = graph.edges()[h.edge()];
        at[h.node].walk = first;
        at[h.node].place = at[i].place + 1;
        at[h.node].variance = at[i].variance + 1.0 / precision_of(precision, h.edge());
        at[h.node].walk_from_node = along_edge(e, at[i].walk_from_node, h.node);
        waiting.push_back(h.node);
      }
    }
  };
  for (Index i = 0; i < n; ++i) {
    if (degree[i] == 1) walk_from(i);
  }
  for (Index i = 0; i < n; ++i) walk_from(i);
  return at;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

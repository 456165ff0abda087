#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What a robust solution says of an edge. All from robust_weight on are outliers.
enum class EdgeVerdict {
  inlier,
  bridge,         ///< no cycle passes through it: nothing checks it
  robust_weight,  ///< its residual is beyond the threshold
  cycle_check,    ///< no short cycle agrees with it: it was left out from the start
  weak_part,      ///< beyond the threshold as well; and no trusted edge joins the same two parts
};

inline bool is_outlier(EdgeVerdict verdict) { return verdict >= EdgeVerdict::robust_weight; }

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

struct EdgeVerdicts {
  std::vector<EdgeVerdict> edges;  ///< (m,)
  /// (n,) the parts that edges which are no outliers hold together. Where a component has more than
  /// one, the rotations of its parts relative to each other rest on distrusted edges alone.
  std::vector<Index> part;
};

/// @param x squared residuals (m,)
/// @param threshold a chord; edges with larger residuals are outliers
/// @param refuted (m,) edges that the cycle check has left out; empty for none
inline EdgeVerdicts edge_verdicts(const MeasurementGraph& graph, const std::vector<double>& x,
                                  double threshold, const std::vector<bool>& refuted) {
  const std::vector<bool> is_bridge = bridges(graph);
  EdgeVerdicts verdicts;
  verdicts.edges.assign(x.size(), EdgeVerdict::inlier);
  std::vector<bool> holds(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) {
    EdgeVerdict& verdict = verdicts.edges[k];
    if (is_bridge[k]) verdict = EdgeVerdict::bridge;
    if (x[k] > threshold * threshold) verdict = EdgeVerdict::robust_weight;
    if (!refuted.empty() && refuted[k]) verdict = EdgeVerdict::cycle_check;
    holds[k] = !is_outlier(verdict);
  }
  verdicts.part = parts_joined_by(graph, holds);
  for (std::size_t k = 0; k < x.size(); ++k) {
    const Edge& e = graph.edges()[k];
    if (verdicts.edges[k] == EdgeVerdict::robust_weight &&
        verdicts.part[e.i] != verdicts.part[e.j]) {
      verdicts.edges[k] = EdgeVerdict::weak_part;
    }
  }
  return verdicts;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
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

#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A series of edges (Series) is judged as a whole, by what it leaves over, in units of its own
/// noise. Of one beyond the threshold those edges are outliers whose own residuals are beyond it,
/// too; if there are none, since they share it, the one with the largest.
///
/// @param x squared residuals (m,)
/// @param precision (m,) in whose units they are judged; empty: all 1
/// @param threshold a chord
/// @param refuted (m,) edges that the cycle check has left out; empty for none
inline EdgeVerdicts edge_verdicts(const MeasurementGraph& graph, const Series& series,
                                  const std::vector<double>& x,
                                  const std::vector<double>& precision, double threshold,
                                  const EdgeKnowledge& known, const std::vector<bool>& refuted) {
  const double most = threshold * threshold;
  const std::vector<double> together = series_residuals(series, x, precision);
  const auto judged = [&](Index k) { return precision_of(precision, k) * x[k]; };
  std::vector<Index> worst(series.size, -1);  // its edge with the largest residual
  EdgeVerdicts verdicts;
  verdicts.edges.assign(x.size(), EdgeVerdict::inlier);
  for (Index k = 0; k < graph.num_edges(); ++k) {
    EdgeVerdict& verdict = verdicts.edges[k];
    const Index s = series.label[k];
    if (known.trusts(k)) {
      verdict = EdgeVerdict::trusted;
    } else if (known.excludes(k)) {
      verdict = EdgeVerdict::excluded;
    } else if (!refuted.empty() && refuted[k]) {
      verdict = EdgeVerdict::cycle_check;
    } else if (s < 0) {
      verdict = judged(k) > most ? EdgeVerdict::robust_weight : EdgeVerdict::bridge;
    } else if (together[s] > most) {
      if (judged(k) > most) verdict = EdgeVerdict::robust_weight;
      if (worst[s] < 0 || judged(k) > judged(worst[s])) worst[s] = k;
    }
  }
  for (const Index k : worst) {
    if (k >= 0) verdicts.edges[k] = EdgeVerdict::robust_weight;
  }

  std::vector<bool> holds(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) holds[k] = !is_outlier(verdicts.edges[k]);
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

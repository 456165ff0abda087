#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/robust/votes.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Lets whole parts vote as take_votes() lets nodes: where a street joins the next by three edges
/// that agree, a wrong one of great weight may hold them, and no node can move alone. Parts are what
/// edges within the threshold hold together without bridges; every edge between two parts, bridges
/// and outliers alike, has one voice on their rotation relative to each other.
///
/// @param x squared residuals (m,)
/// @param precision (m,) in whose units they are judged; empty: all 1
/// @param threshold a chord; edges with larger residuals hold nothing
/// @param R world_from_i, changed in place
/// @returns how many parts moved, each as often as it did
inline Index take_part_votes(const MeasurementGraph& graph, const std::vector<double>& precision,
                             const std::vector<double>& x, double threshold, Rotations& R) {
  std::vector<bool> holds(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) {
    holds[k] = precision_of(precision, k) * x[k] <= threshold * threshold;
  }
  std::vector<bool> left_out = holds;
  left_out.flip();
  const Series series = series_of(graph, left_out);
  for (std::size_t k = 0; k < x.size(); ++k) holds[k] = holds[k] && series.label[k] >= 0;
  const std::vector<Index> part = parts_joined_by(graph, holds);
  std::vector<RelativeRotation> between;
  std::vector<double> units;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge& e = graph.edges()[k];
    if (part[e.i] == part[e.j]) continue;
    RelativeRotation m;  // turn_i R_i R_ij = turn_j R_j
    m.i = part[e.i];
    m.j = part[e.j];
    m.i_from_j = R[e.i] * e.i_from_j * R[e.j].transpose();
    between.push_back(m);
    units.push_back(precision_of(precision, k));
  }
  if (between.empty()) return 0;
  const MeasurementGraph parts(between);
  Rotations turns(parts.nodes().size(), Matrix3::Identity());
  const Index moved = take_votes(parts, std::vector<double>(between.size(), 1.0), units,
                                 {Loss::geman_mcclure, threshold}, turns);
  if (moved == 0) return 0;
  std::vector<Index> row(R.size(), -1);  // of a part
  for (Index k = 0; k < parts.num_nodes(); ++k) row[parts.nodes()[k]] = k;
  for (std::size_t i = 0; i < R.size(); ++i) {
    if (row[part[i]] >= 0) R[i] = turns[row[part[i]]] * R[i];
  }
  return moved;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Of the edges that an answer rejects, those of the largest group that agree on one turn.
///
/// An edge i j that is right would have one of its ends, and what lies beyond, turned by
/// R_i R_ij R_j^T in the world. Edges that are wrong at random each say another turn: that three of
/// a hundred agree within three degrees happens to one graph of a hundred thousand. Where the
/// answer has a part of the graph in the wrong place, or repeated structure would have it in
/// another, all edges between that part and the rest agree.
///
/// @param R world_from_i
/// @param x squared residuals (m,) in units of the noise
/// @param rejected from where on an edge is
/// @param tolerance a chord up to which turns agree; turns of a few times as much are what noise
///        and bent parts leave over, and do not count
inline std::vector<Index> agreeing_turns(const MeasurementGraph& graph, const Rotations& R,
                                         const std::vector<double>& x, double rejected,
                                         double tolerance) {
  constexpr std::size_t enough = 400;
  constexpr double least_turn = 3.0;  // tolerances
  std::vector<Index> edges;
  std::vector<Vector4> turns;
  // r^2 = 4 (1 - s^2) for the cosine s of the angle between two quaternions
  const auto within = [](double s, double r) { return s * s >= 1.0 - 0.25 * r * r; };
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (x[k] <= rejected) continue;
    const Edge e = graph.edges()[k];
    const Matrix3 turn = R[e.i] * e.i_from_j() * R[e.j].transpose();
    const Vector4 q = Quaternion(turn).coeffs();
    if (within(q[3], least_turn * tolerance)) continue;
    edges.push_back(k);
    turns.push_back(q);
  }
  const std::size_t stride = 1 + edges.size() / enough;
  std::vector<Index> most, now;
  for (std::size_t a = 0; a < turns.size(); a += stride) {
    now.clear();
    for (std::size_t b = 0; b < turns.size(); b += stride) {
      const double vectors = turns[a].head<3>().dot(turns[b].head<3>());
      const double scalars = turns[a][3] * turns[b][3];
      // The turn of one side is the inverse turn of the other.
      const bool agree =
          within(scalars + vectors, tolerance) || within(scalars - vectors, tolerance);
      if (agree) now.push_back(edges[b]);
    }
    if (now.size() > most.size()) most = now;
  }
  return most;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

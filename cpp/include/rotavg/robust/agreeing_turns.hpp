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

namespace detail {

/// How many of so many turns drawn at random agree with one of them, within a chord: more do in
/// one case of a thousand. (Each of the others by itself; so their number is Poisson's.)
inline std::size_t agreeing_by_chance(std::size_t turns, double tolerance) {
  constexpr double pi = 3.141592653589793, rarely = 1e-3;
  const double angle = 2.0 * std::asin(std::min(1.0, 0.5 * tolerance));
  // Twice the share of the rotations that turn by less, as a turn may be meant the other way round.
  const double expected = static_cast<double>(turns) * 2.0 * (angle - std::sin(angle)) / pi;
  double term = std::exp(-expected), more = 1.0 - term;
  std::size_t others = 0;
  while (static_cast<double>(turns) * more > rarely && others < turns) {
    ++others;
    term *= expected / static_cast<double>(others);
    more -= term;
  }
  return 1 + others;
}

}  // namespace detail

/// Of the edges that an answer rejects, those of the largest group that agree on one turn; none if
/// chance makes as large a group.
///
/// An edge i j that is right would have one of its ends, and what lies beyond, turned by
/// R_i R_ij R_j^T in the world. Edges that are wrong at random each say another turn. Where the
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
  constexpr std::size_t enough = 400, least = 3;
  constexpr double least_turn = 3.0;  // tolerances
  std::vector<Index> candidates;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (x[k] > rejected) candidates.push_back(k);
  }
  // A chord r is that of two quaternions with the cosine c: r^2 = 4 (1 - c^2).
  const auto within = [](double cosine, double r) { return cosine * cosine >= 1.0 - 0.25 * r * r; };
  const std::size_t stride = (candidates.size() + enough - 1) / enough;
  std::vector<Index> edges;
  std::vector<Vector4> turns;
  for (std::size_t k = 0; k < candidates.size(); k += stride) {
    const Edge e = graph.edges()[candidates[k]];
    const Matrix3 turn = R[e.i] * e.i_from_j() * R[e.j].transpose();
    const Vector4 q = Quaternion(turn).coeffs();
    if (within(q[3], least_turn * tolerance)) continue;
    edges.push_back(candidates[k]);
    turns.push_back(q);
  }
  std::vector<Index> most, now;
  for (const Vector4& a : turns) {
    now.clear();
    for (std::size_t k = 0; k < turns.size(); ++k) {
      const Vector4& b = turns[k];
      const double vectors = a.head<3>().dot(b.head<3>()), scalars = a[3] * b[3];
      // The turn of one side is the inverse turn of the other.
      const bool agree =
          within(scalars + vectors, tolerance) || within(scalars - vectors, tolerance);
      if (agree) now.push_back(edges[k]);
    }
    if (now.size() > most.size()) most = now;
  }
  const std::size_t chance = detail::agreeing_by_chance(turns.size(), tolerance);
  if (most.size() < least || most.size() <= chance) most.clear();
  return most;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

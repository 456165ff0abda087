#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/sides.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Lets whole sides of a graph vote as take_votes() lets nodes: where a street joins the next by
/// two edges that agree, a wrong one of great weight may hold it, and no node can move alone. Of
/// the edges within the threshold those are looked at without which a component would fall apart:
/// the outliers across the same cut have one voice each, as the edge has, on how what lies beyond
/// is turned.
///
/// @param x squared residuals (m,)
/// @param precision (m,) in whose units they are judged; empty: all 1
/// @param threshold a chord; edges with larger residuals hold nothing
/// @param R world_from_i, changed in place
/// @returns how many sides were turned; none lies within another
inline Index take_part_votes(const MeasurementGraph& graph, const std::vector<double>& precision,
                             const std::vector<double>& x, double threshold, Rotations& R) {
  constexpr double clearly = 0.3;
  const detail::Sides sides = detail::sides_of(graph, precision, x, threshold, R);
  return detail::turn_sides(sides, R, [&](Index side, Matrix3& turn) {
    const std::vector<detail::Ballot>& cast = sides.ballots[side];
    if (cast.size() < 2) return false;
    double most = detail::support(cast, Matrix3::Identity()) + clearly;
    bool turned = false;
    const std::size_t stride = detail::stride_of(cast);
    for (std::size_t k = 0; k < cast.size(); k += stride) {
      const double support = detail::support(cast, cast[k].turn);
      if (support <= most) continue;
      most = support;
      turn = cast[k].turn;
      turned = true;
    }
    return turned;
  });
}

/// The other places of sides that a single edge holds and others contradict: either may be wrong.
/// Each is turned as one of those that were rejected says, the one with which most others agree.
///
/// @param least how many nodes a side has that is worth telling
/// @returns at most so many answers, those with the largest sides first
inline std::vector<Rotations> other_places(const MeasurementGraph& graph,
                                           const std::vector<double>& precision,
                                           const std::vector<double>& x, double threshold,
                                           const Rotations& R, double least, std::size_t most) {
  const detail::Sides sides = detail::sides_of(graph, precision, x, threshold, R);
  std::vector<Index> size(sides.parent.size(), 0), chosen;
  for (const Index p : sides.part) ++size[p];
  for (std::size_t k = sides.order.size(); k-- > 0;) {  // the leaves first
    const Index p = sides.order[k];
    if (sides.parent[p] >= 0) size[sides.parent[p]] += size[p];
  }
  const Index all = static_cast<Index>(R.size());
  for (const Index p : sides.order) {
    const bool told = std::min(size[p], all - size[p]) >= least && sides.parent[p] >= 0;
    if (told && !sides.ballots[p].empty()) chosen.push_back(p);
  }
  std::stable_sort(chosen.begin(), chosen.end(), [&](Index a, Index b) {
    return std::min(size[a], all - size[a]) > std::min(size[b], all - size[b]);
  });
  if (chosen.size() > most) chosen.resize(most);
  std::vector<Rotations> answers;
  for (const Index side : chosen) {
    const std::vector<detail::Ballot>& cast = sides.ballots[side];
    const std::size_t stride = detail::stride_of(cast);
    Matrix3 turn = cast.front().turn;
    double support = detail::support(cast, turn);
    for (std::size_t k = stride; k < cast.size(); k += stride) {
      const double now = detail::support(cast, cast[k].turn);
      if (now > support) turn = cast[k].turn;
      support = std::max(support, now);
    }
    std::vector<bool> beyond(size.size(), false);
    for (const Index p : sides.order) {
      beyond[p] = p == side || (sides.parent[p] >= 0 && beyond[sides.parent[p]]);
    }
    answers.push_back(R);
    for (std::size_t i = 0; i < R.size(); ++i) {
      if (beyond[sides.part[i]]) answers.back()[i] = turn * R[i];
    }
  }
  return answers;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

constexpr std::size_t most_candidates = 48;  // ballots that are tried as turns

/// How a rejected edge would have a side turned, and the chord up to which others agree with it.
struct Ballot {
  Matrix3 turn;
  double most2;
  Index edge;
};

/// Every how many of them is tried, so that there are no more than most_candidates.
inline std::size_t stride_of(const std::vector<Ballot>& cast) {
  return cast.empty() ? 1 : 1 + (cast.size() - 1) / most_candidates;
}

/// How much other ballots than the best agree with a turn: as any turn meets one of them exactly,
/// whatever that one says, one does not count.
inline double support(const std::vector<Ballot>& ballots, const Matrix3& turn) {
  double sum = 0.0, best = 0.0;
  for (const Ballot& b : ballots) {
    const double x = std::max(0.0, 3.0 - turn.cwiseProduct(b.turn).sum());
    const double agreement = 1.0 / (1.0 + x / b.most2);
    sum += agreement;
    best = std::max(best, agreement);
  }
  return sum - best;
}

/// The parts of a graph that edges without which it would fall apart join to trees, and what others
/// across the same cuts say of how the side that hangs on a part, with it, is turned.
struct Sides {
  std::vector<Index> part;                   ///< (n,) of every node
  std::vector<Index> parent, order;          ///< of the parts, parents first; a root's parent is -1
  std::vector<Index> holder;                 ///< the edge that joins a part to its parent, or -1
  std::vector<bool> checked, left_out;       ///< (m,) edges that cycles check, and the outliers
  std::vector<std::vector<Ballot>> ballots;  ///< of the outliers, for every part
};

/// @param x, precision, threshold, R as of take_part_votes
inline Sides sides_of(const MeasurementGraph& graph, const std::vector<double>& precision,
                      const std::vector<double>& x, double threshold, const Rotations& R) {
  const double threshold2 = threshold * threshold;
  const auto units = [&](std::size_t k) { return precision_of(precision, k); };
  Sides sides;
  std::vector<bool>&left_out = sides.left_out, &holds = sides.checked;
  left_out.resize(x.size());
  holds.resize(x.size());
  for (Index k = 0; k < graph.num_edges(); ++k) left_out[k] = units(k) * x[k] > threshold2;
  const Series series = series_of(graph, left_out);
  for (std::size_t k = 0; k < x.size(); ++k) holds[k] = !left_out[k] && series.label[k] >= 0;
  sides.part = parts_joined_by(graph, holds);
  const std::vector<Index>& part = sides.part;
  const Index parts = part.empty() ? 0 : 1 + *std::max_element(part.begin(), part.end());

  // The trees in which these edges join parts.
  std::vector<std::vector<Index>> joined(parts);
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge& e = graph.edges()[k];
    if (left_out[k] || part[e.i] == part[e.j]) continue;
    joined[part[e.i]].push_back(k);
    joined[part[e.j]].push_back(k);
  }
  std::vector<Index>&parent = sides.parent, &order = sides.order;
  std::vector<Index> depth(parts, -1);
  parent.assign(parts, -1);
  sides.holder.assign(parts, -1);
  for (Index root = 0; root < parts; ++root) {
    if (depth[root] >= 0) continue;
    depth[root] = 0;
    order.push_back(root);
    for (std::size_t at = order.size() - 1; at < order.size(); ++at) {
      const Index p = order[at];
      for (const Index k : joined[p]) {
        const Edge& e = graph.edges()[k];
        const Index q = part[e.i] == p ? part[e.j] : part[e.i];
        if (depth[q] >= 0) continue;
        depth[q] = depth[p] + 1;
        parent[q] = p;
        sides.holder[q] = k;
        order.push_back(q);
      }
    }
  }

  sides.ballots.resize(parts);
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge& e = graph.edges()[k];
    Index i = part[e.i], j = part[e.j];
    if (!left_out[k] || i == j || !(units(k) > 0.0)) continue;
    const Matrix3 of_j = R[e.i] * e.i_from_j() * R[e.j].transpose();
    const double most2 = threshold2 / units(k);
    std::vector<std::pair<Index, bool>> path;
    while (i != j && i >= 0 && j >= 0) {
      const bool from_i = depth[i] >= depth[j];
      path.emplace_back(from_i ? i : j, from_i);
      (from_i ? i : j) = parent[from_i ? i : j];
    }
    if (i != j) continue;  // of two trees
    for (const auto& [side, from_i] : path) {
      sides.ballots[side].push_back({from_i ? Matrix3(of_j.transpose()) : of_j, most2, k});
    }
  }
  return sides;
}

/// Turns sides, from the root on; what lies beyond a side that was turned turns with it, and is not
/// asked again.
/// @param choose `choose(side, turn)` gives a side its turn, if it wants one, and tells whether
/// @param R world_from_i, changed in place
/// @returns how many sides were turned
template <typename Choose>
Index turn_sides(const Sides& sides, Rotations& R, Choose&& choose) {
  std::vector<Matrix3> turn(sides.parent.size(), Matrix3::Identity());
  std::vector<bool> turned(turn.size(), false);
  Index moved = 0;
  for (const Index p : sides.order) {
    if (sides.parent[p] < 0) continue;
    turn[p] = turn[sides.parent[p]];
    turned[p] = turned[sides.parent[p]];
    if (turned[p]) continue;
    turned[p] = choose(p, turn[p]);
    moved += turned[p];
  }
  if (moved == 0) return 0;
  for (std::size_t i = 0; i < R.size(); ++i) R[i] = turn[sides.part[i]] * R[i];
  return moved;
}

}  // namespace detail

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

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/graph/common_ancestors.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
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
    const double agreement = 1.0 / (1.0 + squared_chord(turn, b.turn) / b.most2);
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
  std::vector<std::vector<Ballot>> ballots;  ///< of outliers, for every part
};

/// An outlier whose ends lie in two parts, where the path between these turns, and how many sides
/// it has a voice on.
struct Voter {
  Index edge, top, sides;
};

/// Where paths are long, as on a chain of poses, all voices would take time and memory like the
/// square of its length. So of those with the longest paths some are heard, so that they have no
/// more than a million or two, a hundred bytes each; which, their order does not tell.
inline std::vector<Voter> heard(std::vector<Voter> voters) {
  constexpr double most_voices = 5e5;  // of the short paths, and about as many of the long ones
  double all = 0.0;
  for (const Voter& v : voters) all += v.sides;
  if (all <= 2.0 * most_voices) return voters;
  std::vector<Index> lengths;
  for (const Voter& v : voters) lengths.push_back(v.sides);
  std::sort(lengths.begin(), lengths.end());
  double short_ones = 0.0;
  Index longest = 0;
  for (const Index length : lengths) {
    if (short_ones + length > most_voices) break;
    short_ones += length;
    longest = length;
  }
  // Those of just this length may be many: they count as long.
  short_ones = 0.0;
  for (const Voter& v : voters) short_ones += v.sides < longest ? v.sides : 0;
  const double share = most_voices / (all - short_ones);
  const double bound = share * static_cast<double>(std::numeric_limits<std::uint64_t>::max());
  const auto silent = [&](const Voter& v) {
    return v.sides >= longest &&
           static_cast<double>(scrambled(static_cast<std::uint64_t>(v.edge))) >= bound;
  };
  voters.erase(std::remove_if(voters.begin(), voters.end(), silent), voters.end());
  return voters;
}

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
  std::vector<bool> reached(parts, false);
  parent.assign(parts, -1);
  sides.holder.assign(parts, -1);
  for (Index root = 0; root < parts; ++root) {
    if (reached[root]) continue;
    reached[root] = true;
    order.push_back(root);
    for (std::size_t at = order.size() - 1; at < order.size(); ++at) {
      const Index p = order[at];
      for (const Index k : joined[p]) {
        const Edge& e = graph.edges()[k];
        const Index q = part[e.i] == p ? part[e.j] : part[e.i];
        if (reached[q]) continue;
        reached[q] = true;
        parent[q] = p;
        sides.holder[q] = k;
        order.push_back(q);
      }
    }
  }

  // An outlier has a voice on every side whose cut it crosses, those on the path between its ends.
  const CommonAncestors common(parent, order);
  std::vector<Voter> voters;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Index i = part[graph.edges()[k].i], j = part[graph.edges()[k].j];
    if (!left_out[k] || i == j || !(units(k) > 0.0)) continue;
    const Index top = common(i, j);
    if (top < 0) continue;  // of two trees
    voters.push_back({k, top, common.depth(i) + common.depth(j) - 2 * common.depth(top)});
  }
  sides.ballots.resize(parts);
  for (const Voter& voter : heard(std::move(voters))) {
    const Edge& e = graph.edges()[voter.edge];
    const Matrix3 of_j = R[e.i] * e.i_from_j() * R[e.j].transpose();
    const Matrix3 of_i = of_j.transpose();
    const double most2 = threshold2 / units(voter.edge);
    for (Index p = part[e.i]; p != voter.top; p = parent[p]) {
      sides.ballots[p].push_back({of_i, most2, voter.edge});
    }
    for (Index p = part[e.j]; p != voter.top; p = parent[p]) {
      sides.ballots[p].push_back({of_j, most2, voter.edge});
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

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The other ways to get from one end of an edge to the other: by two more edges, which make a
/// triangle with it, or by one parallel to it.
class Detours {
 public:
  explicit Detours(const MeasurementGraph& graph) {
    edges_.reserve(graph.edges().size());
    for (const Edge& e : graph.edges()) {
      const WeightedQuaternion q = e.quaternion.normalized();
      edges_.push_back({Quaternion(q.w(), q.x(), q.y(), q.z()), e.weight, e.i, e.j});
    }
    neighbours_.resize(static_cast<std::size_t>(graph.num_nodes()));
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      for (const HalfEdge& h : graph.row(l)) neighbours_[l].emplace_back(h.node, h.edge());
      std::sort(neighbours_[l].begin(), neighbours_[l].end());
    }
    constexpr Index enough_together = 4'000'000, least = 8, most = 64;
    probes_ = std::clamp(enough_together / std::max<Index>(graph.num_edges(), 1), least, most);
  }

  /// Calls visit(distance2, weight) for the detours of an edge, with the squared distance between
  /// the unit quaternions of the detour and of the edge (about a quarter of the angle's square),
  /// and the detour's weight, 1 / (1 / w + 1 / w') for two edges as variances add up. By every
  /// third node there is one: of edges that are parallel there, those that agree best, as they are
  /// no detours of their own where what they share is wrong. Where an end has many neighbours, only
  /// some of them, evenly spaced, are tried.
  /// @returns of how many neighbours one was tried
  template <typename Visit>
  Index visit(Index edge, Visit&& visit) const {
    const UnitEdge& e = edges_[edge];
    const std::size_t of_i = neighbours_[e.i].size(), of_j = neighbours_[e.j].size();
    const bool from_i = of_i == of_j ? e.i < e.j : of_i < of_j;  // whichever way it was measured
    const Index a = from_i ? e.i : e.j, b = from_i ? e.j : e.i;
    const auto& starts = neighbours_[a];
    const auto size = static_cast<Index>(starts.size());
    const Index stride = (size + probes_ - 1) / probes_;
    const Quaternion a_from_b = e.from(a);
    Index last = -1;  // third node
    for (Index k = edge % stride; k < size; k += stride) {
      const auto [node, first] = starts[k];
      if (node == b) {
        if (first == edge) continue;
        const UnitEdge& there = edges_[first];
        visit(squared_distance(there.from(a), a_from_b), there.weight);
      } else if (node != last) {
        best_by(node, a, b, a_from_b, visit);
      }
      last = node;
    }
    return stride;
  }

 private:
  struct UnitEdge {
    Quaternion i_from_j;
    double weight;
    Index i, j;
    /// a_from_other, for a one of the ends.
    Quaternion from(Index a) const { return a == i ? i_from_j : i_from_j.conjugate(); }
  };

  /// Visits the detour from a to b by this node that agrees best, if there is any.
  template <typename Visit>
  void best_by(Index node, Index a, Index b, const Quaternion& a_from_b, Visit&& visit) const {
    const auto [there, there_end] = parallel(a, node);
    const auto [back, back_end] = parallel(b, node);
    double least = std::numeric_limits<double>::infinity(), weight = 0.0;
    for (auto p = there; p != there_end; ++p) {
      for (auto q = back; q != back_end; ++q) {
        const UnitEdge &first = edges_[p->second], &second = edges_[q->second];
        const double distance2 =
            squared_distance(Quaternion(product(first.from(a), second.from(node))), a_from_b);
        if (!(distance2 < least)) continue;
        least = distance2;
        weight = first.weight / (1.0 + first.weight / second.weight);
      }
    }
    if (weight > 0.0) visit(least, weight);
  }

  using Neighbours = std::vector<std::pair<Index, Index>>;  ///< (node, edge), rising

  /// The edges between two nodes, eight at most.
  std::pair<Neighbours::const_iterator, Neighbours::const_iterator> parallel(Index l,
                                                                             Index node) const {
    constexpr std::ptrdiff_t most = 8;
    const Neighbours& row = neighbours_[l];
    const auto first = std::lower_bound(row.begin(), row.end(), std::make_pair(node, Index{0}));
    auto end = first;
    while (end != row.end() && end - first < most && end->first == node) ++end;
    return {first, end};
  }

  std::vector<UnitEdge> edges_;
  std::vector<Neighbours> neighbours_;
  Index probes_ = 0;  // at most, for an edge
};

/// How much the graph says for each measurement: its own weight, and the weights of its detours,
/// each by how well it agrees,
///
///     w_ij + sum over the detours from i to j of w (1 + d^2 / s^2)^-2,
///
/// with d the distance of Detours and the weight function of Geman and McClure (1985), which all
/// but ignores a detour that does not agree. The scale s is the distance that one detour in ten
/// stays below: it follows the noise, whatever its size, even where half of the edges are outliers,
/// since one triangle in eight is then free of them.
///
/// @param keep_going asked every few milliseconds; false stops, and the rest have their own weight
inline std::vector<double> edge_support(const MeasurementGraph& graph,
                                        const std::function<bool()>& keep_going = {}) {
  constexpr Index edges_between_questions = 1024;
  constexpr Index edges_for_scale = 20'000;
  constexpr double rounding2 = 1e-24;  // below it, detours agree exactly
  const Detours detours(graph);
  std::vector<double> distances2;
  const Index stride = std::max<Index>(1, graph.num_edges() / edges_for_scale);
  for (Index edge = 0; edge < graph.num_edges(); edge += stride) {
    detours.visit(edge, [&](double distance2, double) { distances2.push_back(distance2); });
  }
  double scale2 = rounding2;
  if (!distances2.empty()) {
    const auto tenth = distances2.begin() + static_cast<std::ptrdiff_t>(distances2.size() / 10);
    std::nth_element(distances2.begin(), tenth, distances2.end());
    scale2 += *tenth;
  }

  std::vector<double> support;
  support.reserve(graph.edges().size());
  for (const Edge& edge : graph.edges()) support.push_back(edge.weight);
  for (Index edge = 0; edge < graph.num_edges(); ++edge) {
    if (edge % edges_between_questions == 0 && keep_going && !keep_going()) break;
    double sum = 0.0;
    const Index one_of = detours.visit(edge, [&](double distance2, double weight) {
      const double share = scale2 / (scale2 + distance2);
      sum += weight * share * share;
    });
    support[edge] += one_of * sum;
  }
  return support;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

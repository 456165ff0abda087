#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/radix_sort.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the neighbours of an edge's ends say of it, apart from what it says itself.
///
/// Cameras that see the same share most of their neighbours, and the triangles with these agree.
/// Edges that are wrong at random agree with no triangle. Facades that only look alike agree with
/// one another, but those whom they confuse share few neighbours: pairs that ought to match, if it
/// were true, do not (Wilson and Snavely 2013; Yan et al. 2017).
class Neighbourhoods {
 public:
  /// Of large graphs, where that would take long, every so-maniest node is a common neighbour.
  ///
  /// @param keep_going asked every few milliseconds; false stops, and the rest counts for nothing
  explicit Neighbourhoods(
      const MeasurementGraph& graph, std::function<bool()> keep_going = [] { return true; })
      : graph_(&graph), keep_going_(std::move(keep_going)) {
    constexpr double most_work = 5e7, enough_work = 1e5;  // steps; triangles are kept
    double work = 0.0;
    for (Index k = 0; k < graph.num_nodes(); ++k) {
      for (const HalfEdge& h : graph.row(k)) work += graph.row(h.node).size();
    }
    // At least one node is looked at.
    const double all = std::max(1.0, static_cast<double>(graph.num_nodes() - 1));
    stride_ = static_cast<Index>(std::min(all, 1.0 + std::floor(work / most_work)));
    std::vector<double> x;
    visit_triangles(static_cast<Index>(std::min(all, stride_ + std::floor(work / enough_work))),
                    false, [&](const Triangle&, double x_k) { x.push_back(x_k); });
    const double most = agreement(std::move(x));
    once_ = stride_ == 1 && !has_parallel_edges(graph);
    visit_triangles(stride_, once_, [&](const Triangle& t, double x_k) {
      if (x_k <= most) agreeing_.push_back(t);
    });
  }

  /// Whether there is anything to tell: more agreeing triangles than one for twenty edges, as there
  /// are not on a trajectory.
  bool are_informative() const {
    constexpr double few = 0.05;
    const double triangles = static_cast<double>(agreeing_.size()) * stride_ / (once_ ? 1.0 : 3.0);
    return triangles > few * graph_->num_edges();
  }

  /// How much (m,) the neighbourhoods of an edge's two ends overlap, 0 to 1: the weighted Jaccard
  /// index, where a common neighbour counts only if its triangle agrees,
  ///
  ///     sum over k of min(w_ik, w_jk) / sum over k of max(w_ik, w_jk).
  ///
  /// @param weights (m,)
  std::vector<double> overlap(const std::vector<double>& weights) const {
    constexpr double own_share = 1e-3;  // tells edges apart that agree with no triangle
    const MeasurementGraph& graph = *graph_;
    std::vector<double> shared(weights.size(), 0.0), all(graph.num_nodes(), 0.0);
    for (std::int64_t k = 0; k < graph.num_nodes(); k += stride_) {
      for (const HalfEdge& h : graph.row(static_cast<Index>(k))) all[h.node] += weights[h.edge()];
    }
    for (const Triangle& t : agreeing_) {
      shared[t.ij] += std::min(weights[t.ik], weights[t.jk]);
      if (!once_) continue;
      shared[t.ik] += std::min(weights[t.ij], weights[t.jk]);
      shared[t.jk] += std::min(weights[t.ij], weights[t.ik]);
    }
    for (std::size_t k = 0; k < shared.size(); ++k) {
      const Edge& e = graph.edges()[k];
      const double either = all[e.i] + all[e.j] - shared[k];
      const double own = own_share * weights[k];
      shared[k] = (shared[k] + own) / std::max(either + own, 1e-300);
    }
    return shared;
  }

 private:
  /// A common neighbour k of i and j, by its edges.
  struct Triangle {
    Index ij, ik, jk;
  };

  /// Calls visit(triangle, x) for all, with x the squared chord by which it misses the identity,
  /// for every stride-th k, or once, as that of its first corner. Of edges parallel to ik and jk
  /// one is looked at.
  template <typename Visit>
  void visit_triangles(Index stride, bool once, Visit&& visit) const {
    constexpr Index steps_between_questions = 1000000;
    const MeasurementGraph& graph = *graph_;
    std::vector<Index> to(graph.num_nodes(), -1);  // the place of the half-edge in the row of k
    Index steps = 0;
    for (std::int64_t next = 0; next < graph.num_nodes(); next += stride) {
      const auto k = static_cast<Index>(next);
      const HalfEdges row = graph.row(k);
      const Index degree = row.size();
      for (Index a = 0; a < degree; ++a) to[row[a].node] = a;
      for (Index a = 0; a < degree; ++a) {
        const HalfEdge ik = row[a];
        const Index i = ik.node;
        if (to[i] != a || i == k || (once && i < k)) continue;
        steps += std::min(graph.row(i).size(), steps_between_questions);
        if (steps >= steps_between_questions && !keep_going_()) return;
        steps %= steps_between_questions;
        for (const HalfEdge& ij : graph.row(i)) {
          const Index j = ij.node;
          if (j <= i || j == k || to[j] < 0) continue;
          const HalfEdge jk = row[to[j]];
          // j_from_i against j_from_k k_from_i, which have the square roots of weights for norms
          const Vector4 detour = product(jk.node_from_l, ik.node_from_l.conjugate());
          const double cosine = detour.dot(ij.node_from_l.coeffs());
          const double norm2 = detour.squaredNorm() * ij.node_from_l.squaredNorm();
          visit(Triangle{ij.edge(), ik.edge(), jk.edge()},
                4.0 * std::max(0.0, 1.0 - cosine * cosine / norm2));
        }
      }
      for (const HalfEdge& h : row) to[h.node] = -1;
    }
  }

  static bool has_parallel_edges(const MeasurementGraph& graph) {
    std::vector<Index> seen_by(graph.num_nodes(), -1);
    for (Index k = 0; k < graph.num_nodes(); ++k) {
      for (const HalfEdge& h : graph.row(k)) {
        if (std::exchange(seen_by[h.node], k) == k) return true;
      }
    }
    return false;
  }

  /// The squared chord up to which triangles agree: three standard deviations of those that do, by
  /// the fixed point of noise_scale(), which starts from the smallest tenth.
  static double agreement(std::vector<double> x) {
    constexpr double rounding2 = 1e-24, most2 = 0.25;
    using detail::median_below_three, detail::tenth_of_half_normal;
    if (x.empty()) return rounding2;
    radix_sort(x);
    double s2 = x[x.size() / 10] / (tenth_of_half_normal * tenth_of_half_normal);
    for (int k = 0; k < 100; ++k) {
      const auto below = std::upper_bound(x.begin(), x.end(), 9.0 * s2) - x.begin();
      const double next = x[below / 2] / (median_below_three * median_below_three);
      if (std::abs(next - s2) <= 1e-9 * s2) break;
      s2 = next;
    }
    return std::clamp(9.0 * s2, rounding2, most2);
  }

  const MeasurementGraph* graph_;
  std::function<bool()> keep_going_;
  Index stride_ = 1;                // of the nodes whose triangles are looked at
  bool once_ = false;               // for all three corners, where these are looked at alike
  std::vector<Triangle> agreeing_;  // those that do
};

}  // namespace rotavg

#pragma GCC diagnostic pop

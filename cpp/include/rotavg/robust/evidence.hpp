#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/comparison.hpp>
#include <rotavg/robust/strongest.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Which of two answers the edges speak for.
///
/// Edges that agree on a wrong answer are no independent witnesses: one facade that looks like
/// another makes hundreds of them. So their number says little. What says more is what they weigh,
/// for how far they turn (relative_weights): what only looks alike matches less than true
/// neighbours do. And a camera's nearest neighbours, with whom it shares most, are hardly ever
/// confused. Every camera therefore has some voices, which its strongest edges have (strongest),
/// and all voices count the same. (shared_strongest tells how strong edges are.)
class Evidence {
 public:
  /// @param graph must outlive this object
  /// @param strength (m,) of the edges
  /// @param relative (m,) relative_weights; empty where all weights are the same
  Evidence(const MeasurementGraph& graph, const std::vector<double>& strength,
           const std::vector<double>& relative)
      : graph_(&graph), voices_(strongest(graph, strength)) {
    constexpr double most = 5.0;
    for (const double w : relative) log_weights_.push_back(std::clamp(std::log(w), -most, most));
  }

  /// (m,) how many voices every edge has: 0, 1 or 2.
  const std::vector<double>& voices() const { return voices_; }

  /// Of the pairs of cameras that have a common neighbour across the given edges, the share that
  /// match. True neighbours share theirs; of cameras that see two copies of one thing, only those
  /// match that see it from the same side.
  double closure(const std::vector<Index>& edges) const {
    constexpr std::size_t most_edges = 400;
    const std::size_t stride = 1 + edges.size() / most_edges;
    std::vector<bool> near(static_cast<std::size_t>(graph_->num_nodes()), false);
    double closed = 0.0, pairs = 0.0;
    for (std::size_t k = 0; k < edges.size(); k += stride) {
      const Edge& e = graph_->edges()[edges[k]];
      for (const HalfEdge& h : graph_->row(e.j)) near[h.node] = true;
      for (const HalfEdge& h : graph_->row(e.i)) {
        if (h.node == e.j) continue;
        pairs += 1.0;
        closed += near[h.node];
      }
      for (const HalfEdge& h : graph_->row(e.j)) near[h.node] = false;
    }
    return pairs > 0.0 ? closed / pairs : 0.0;
  }

  /// Whether there is no doubt that the first of two answers is the better one.
  ///
  /// Where the other explains many edges that the first does not, of all and beside those that only
  /// the first explains, one cause makes them all, and either answer may be the folded one. Then
  /// the weights must speak clearly; where they tell nothing, the voices must be all but unanimous,
  /// and the pairs that ought to match and do not bear them out. Where it explains few, chance is
  /// the other cause, and the voices decide by their number.
  bool rules_out_other(const std::vector<double>& x, const std::vector<double>& other) const {
    constexpr double many_edges = 0.02, as_many = 0.3, chance = 3.0;
    // As chance, of edges that are not independent: what a camera sees makes all of its edges light
    // or heavy. With a correlation of a quarter (0 to .6 on graphs that were measured) and eight
    // edges of a camera in a bundle, the variance of a mean is 1 + 7 / 4 = 1.66^2 times what t
    // takes it for. To prefer a story wants less than to keep one back, as that one is told all the
    // same.
    constexpr double clear = 5.0;
    constexpr double dissent = 0.03, less = 0.7;
    const Comparison c = compare(x, other);
    const bool many = c.other_edges() >= many_edges * static_cast<double>(voices_.size()) &&
                      c.other_edges() >= as_many * c.edges();
    if (!many) return c.lead() > chance;
    if (!log_weights_.empty()) return c.lead_in_weight() > clear;
    if (c.lead() <= clear || c.other_voices > dissent * c.voices) return false;
    return closure(c.only_other) < less * closure(c.only_first);
  }

  /// @param x, other squared residuals (m,) in units of the noise: an edge is explained by an
  ///        answer if they are clearly smaller, by half of the sixteen up to which they count
  /// @param uncounted (n,) nodes whose edges do not count; empty: none
  Comparison compare(const std::vector<double>& x, const std::vector<double>& other,
                     const std::vector<bool>& uncounted = {}) const {
    constexpr double most = contradiction;
    Comparison c;
    for (std::size_t k = 0; k < x.size(); ++k) {
      const Edge& e = graph_->edges()[k];
      if (!uncounted.empty() && (uncounted[e.i] || uncounted[e.j])) continue;
      const double gain = std::min(other[k], most) - std::min(x[k], most);
      if (gain > 0.5 * most) {
        c.voices += voices_[k];
        c.only_first.push_back(static_cast<Index>(k));
      } else if (gain < -0.5 * most) {
        c.other_voices += voices_[k];
        c.only_other.push_back(static_cast<Index>(k));
      }
    }
    c.in_weight = contrast(c.only_first, c.only_other);
    return c;
  }

 private:
  /// By how many of its standard deviations the mean of the logarithms of the first's weights is
  /// the greater: Welch's t, and of a few edges the deviations of a normal distribution that are as
  /// rare (Wallace 1959). It tells nothing where one answer explains hardly any edges, as a few
  /// that are wrong by chance may be as heavy as they like, and those that join parts are light:
  ///
  /// - fewer than one in a hundred. A story moves two cameras in a hundred, to which at least one
  ///   edge in a hundred belongs, if they are no lighter connected than others;
  /// - or ten times fewer than the other. Such a remnant is picked out, at the seams of groups or
  ///   by what was bent to meet it, and not drawn at random as t supposes: of normal logarithms the
  ///   heaviest tenth has a mean that is 1.75 deviations of one edge too great, whatever their
  ///   number, and t grows with the root of it.
  double contrast(const std::vector<Index>& first, const std::vector<Index>& other) const {
    constexpr std::size_t times_as_many = 10;
    constexpr double least_share = 0.01;
    constexpr double least_deviation = 0.1;  // weights that are all alike tell nothing
    const std::size_t less = std::min(first.size(), other.size());
    const std::size_t more = std::max(first.size(), other.size());
    const double few = std::max(4.0, least_share * static_cast<double>(log_weights_.size()));
    if (log_weights_.empty() || static_cast<double>(less) < few) return 0.0;
    if (more > times_as_many * less) return 0.0;
    const auto moments = [&](const std::vector<Index>& edges) {
      double sum = 0.0, squares = 0.0;
      for (const Index k : edges) sum += log_weights_[k];
      const double count = static_cast<double>(edges.size()), mean = sum / count;
      for (const Index k : edges) squares += (log_weights_[k] - mean) * (log_weights_[k] - mean);
      return std::pair(mean, squares / (count - 1.0) / count);
    };
    const auto [mean, variance] = moments(first);
    const auto [other_mean, other_variance] = moments(other);
    const double least = least_deviation * least_deviation / static_cast<double>(less);
    const double t = (mean - other_mean) / std::sqrt(std::max(least, variance + other_variance));
    const double v1 = std::max(least, variance), v2 = std::max(least, other_variance);
    const double freedom = (v1 + v2) * (v1 + v2) /
                           (v1 * v1 / static_cast<double>(first.size() - 1) +
                            v2 * v2 / static_cast<double>(other.size() - 1));
    const double z = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0) *
                     std::sqrt(freedom * std::log1p(t * t / freedom));
    return std::copysign(z, t);
  }

  const MeasurementGraph* graph_;
  std::vector<double> voices_;
  std::vector<double> log_weights_;  // (m,) relative; empty if they tell nothing
};

}  // namespace rotavg

#pragma GCC diagnostic pop

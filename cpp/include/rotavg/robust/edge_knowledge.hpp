#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the weights of a graph say, to a robust loss.
enum class WeightKind {
  automatic,  ///< precision
  /// A weight is the inverse of the noise's variance, up to a common factor: residuals are judged
  /// in units of 1 / sqrt(weight), and no edge, however heavy, outvotes another by more than that.
  precision,
  /// A weight is how often the edge was measured: a residual of an edge is judged as that of any
  /// other, and a heavy edge outvotes several light ones.
  frequency,
};

/// What is known of the edges before any residual is seen; each is (m,), or empty.
struct EdgeKnowledge {
  std::vector<bool> trusted;   ///< edges that the loss does not touch: least squares, always
  std::vector<bool> excluded;  ///< edges that are left out, but for what keeps the graph connected
  /// Factors by which the scale of the loss, and the threshold of outliers, differ from edge to
  /// edge; positive. They replace what the weights say.
  std::vector<double> scales;
  /// Robust weights, 0 to 1, with which the first least squares are solved; these need no l1 then.
  std::vector<double> initial_weights;
  /// Edges that are hardly ever wrong, as a trajectory's odometry is. It counts where nothing is
  /// trusted: of two answers the one that bends fewer of them may be preferred (odometry.hpp).
  std::vector<bool> odometry{};

  /// @throws std::invalid_argument unless all are of m edges and in range
  void check(const MeasurementGraph& graph) const {
    const auto refuse = [&](const std::string& name, std::size_t size) {
      if (size == 0 || size == graph.edges().size()) return;
      throw std::invalid_argument(name + " has " + std::to_string(size) + " entries; expected " +
                                  std::to_string(graph.edges().size()) + ", one for each edge");
    };
    refuse("trusted", trusted.size());
    refuse("excluded", excluded.size());
    refuse("scales", scales.size());
    refuse("initial_weights", initial_weights.size());
    refuse("odometry", odometry.size());
    constexpr double least = 1e-50, most = 1e50;
    for (std::size_t k = 0; k < scales.size(); ++k) {
      if (scales[k] >= least && scales[k] <= most) continue;
      throw std::invalid_argument("edge " + std::to_string(k) + ": its scale is " +
                                  six_digits(scales[k]) + "; expected 1e-50 to 1e50");
    }
    for (std::size_t k = 0; k < initial_weights.size(); ++k) {
      if (initial_weights[k] >= 0.0 && initial_weights[k] <= 1.0) continue;
      throw std::invalid_argument("edge " + std::to_string(k) + ": its initial weight is " +
                                  six_digits(initial_weights[k]) + "; expected 0 to 1");
    }
    for (std::size_t k = 0; k < std::min(trusted.size(), excluded.size()); ++k) {
      if (!trusted[k] || !excluded[k]) continue;
      throw std::invalid_argument("edge " + std::to_string(k) + " is both trusted and excluded");
    }
  }

  /// The same of some of the edges.
  EdgeKnowledge of(const std::vector<Index>& edges) const {
    EdgeKnowledge some;
    for (const Index k : edges) {
      if (!trusted.empty()) some.trusted.push_back(trusted[k]);
      if (!excluded.empty()) some.excluded.push_back(excluded[k]);
      if (!scales.empty()) some.scales.push_back(scales[k]);
      if (!initial_weights.empty()) some.initial_weights.push_back(initial_weights[k]);
      if (!odometry.empty()) some.odometry.push_back(odometry[k]);
    }
    return some;
  }

  bool trusts(Index k) const { return !trusted.empty() && trusted[k]; }
  bool excludes(Index k) const { return !excluded.empty() && excluded[k]; }
};

/// In what units the edges are judged.
struct EdgeUnits {
  /// (m,) of every edge: the square of the inverse of its scale, or its weight over the median
  /// weight; 1 where the weights are frequencies; 0 of trusted edges. Empty: all 1.
  std::vector<double> precision;
  /// (m,) the same as if no edge were trusted; empty where none is.
  std::vector<double> free_precision;
  /// (m,) weights for where most is still wrong: every edge has one voice, whatever its precision,
  /// since edges that are wrong, but said to be precise, would drown all others. Empty: the given.
  std::vector<double> voices;
  double voice = 1.0;  ///< of all but trusted edges, which have their weight
};

/// From now on these edges (m,) are trusted.
/// @param weights (m,) of the edges
inline void trust(const std::vector<bool>& edges, const std::vector<double>& weights,
                  EdgeUnits& units) {
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (!edges[k]) continue;
    if (units.precision.empty()) units.precision.assign(edges.size(), 1.0);
    if (units.free_precision.empty()) units.free_precision = units.precision;
    units.precision[k] = 0.0;
    if (!units.voices.empty()) units.voices[k] = weights[k];
  }
}

/// As many closures as one edge of odometry counts, where it is favoured: closures are made by
/// recognising places, and one mistake makes many that agree, while a step of odometry goes wrong
/// by itself, and seldom. So a loss that counts all edges alike would rather bend a few steps than
/// give up as many closures and one more.
constexpr double closures_a_step = 6.0;

/// Favours odometry: its scale is so much larger that giving a step up costs as much as six
/// closures.
/// @param odometry (m,) edges, or empty for none
/// @param precision (m,) by which residuals are judged; empty: all 1
inline void favour(const std::vector<bool>& odometry, std::vector<double>& precision) {
  if (odometry.empty()) return;
  if (precision.empty()) precision.assign(odometry.size(), 1.0);
  for (std::size_t k = 0; k < odometry.size(); ++k) {
    if (odometry[k]) precision[k] /= closures_a_step;
  }
}

/// @param typical edges whose median weight is the unit, but for excluded ones; empty: all
inline EdgeUnits edge_units(const MeasurementGraph& graph, const EdgeKnowledge& known,
                            WeightKind kind, const std::vector<Index>& typical = {}) {
  EdgeUnits units;
  const bool uneven = graph.max_weight() > graph.min_weight();
  if (kind != WeightKind::frequency && uneven) {
    for (const Edge& e : graph.edges()) units.precision.push_back(e.weight);
    std::vector<double> sorted;
    const auto take = [&](Index k) {
      if (!known.excludes(k)) sorted.push_back(units.precision[k]);
    };
    for (const Index k : typical) take(k);
    for (Index k = 0; k < graph.num_edges() && typical.empty(); ++k) take(k);
    if (sorted.empty()) sorted = units.precision;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    for (double& p : units.precision) p /= *middle;
    units.voice = *middle;
    units.voices.assign(units.precision.size(), units.voice);
  }
  if (!known.scales.empty()) {
    units.precision.clear();
    for (const double scale : known.scales) units.precision.push_back(1.0 / (scale * scale));
  }
  trust(known.trusted, graph.weights(), units);
  return units;
}

/// Leaves edges out, but for a weight that keeps the graph connected: a small share of their own,
/// or of the lightest edge that stays, if that is less.
inline void leave_out(const std::vector<bool>& edges, std::vector<double>& weights) {
  double lightest = max_weight;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    if (!edges[k]) lightest = std::min(lightest, weights[k]);
  }
  for (std::size_t k = 0; k < weights.size(); ++k) {
    if (!edges[k]) continue;
    weights[k] = std::max(min_weight, least_weight_share * std::min(weights[k], lightest));
  }
}

}  // namespace rotavg

#pragma GCC diagnostic pop

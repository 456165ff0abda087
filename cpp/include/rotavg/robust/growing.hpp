#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/effective_resistance.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/some_edges.hpp>
#include <rotavg/solve/status.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// A spanning tree, and the closures that it bears out.
class GrowingPart {
 public:
  /// @param graph that the run is of; must outlive this object, as the run must
  GrowingPart(RobustRun& run, const MeasurementGraph& graph)
      : run_(run), graph_(graph), taken_(graph.edges().size(), false) {
    std::vector<double> key;  // precision, trusted edges before all others
    for (Index k = 0; k < graph.num_edges(); ++k) {
      const double precision = precision_of(run.free_precision(), static_cast<std::size_t>(k));
      precision_.push_back(std::clamp(precision, min_weight, max_weight));
      key.push_back(precision_.back() * (run.trusts(k) ? max_weight * max_weight : 1.0));
    }
    const std::vector<Index> tree = maximum_spanning_forest(graph, key, run.keep_going());
    for (const Index k : tree) taken_[k] = true;
    R_ = along_forest(graph, tree);
    for (Index k = 0; k < graph.num_edges(); ++k) {
      if (taken_[k]) continue;
      if (run.trusts(k)) {
        taken_[k] = true;
        closes_cycles_ = true;
        continue;
      }
      closures_.push_back(k);
      ends_.emplace_back(graph.edges()[k].i, graph.edges()[k].j);
    }
    variance_.resize(closures_.size());
    misfit_ = variance_;
    was_left_.resize(closures_.size(), false);
  }

  bool has_closures() const { return !closures_.empty(); }
  Rotations rotations() && { return std::move(R_); }

  /// Least squares of what was taken; of every closure its squared residual beside what is expected
  /// of it; and the noise.
  /// @returns whether there was time
  bool test() {
    if (!goes_on()) return false;
    std::vector<Index> edges;
    std::vector<double> weights;
    for (Index k = 0; k < graph_.num_edges(); ++k) {
      if (!taken_[k]) continue;
      edges.push_back(k);
      weights.push_back(precision_[k]);
    }
    const MeasurementGraph part = some_edges(graph_, edges, weights);
    if (closes_cycles_) R_ = run_.least_squares_of(part, std::move(R_));
    const auto resistance = effective_resistances(part, ends_, flops_an_edge * graph_.num_edges(),
                                                  run_.num_threads(), run_.keep_going());
    if (!resistance || !goes_on()) return false;
    const std::vector<double>& x = run_.squared_residuals_at(R_);
    std::vector<double> met;
    for (std::size_t c = 0; c < closures_.size(); ++c) {
      const Index k = closures_[c];
      const double own = 1.0 / precision_[k], others = (*resistance)[c];
      variance_[c] = own + (taken_[k] ? 0.0 : others);
      misfit_[c] = x[k] / variance_[c];
      // What was taken is met the better the less the others know: its variance is own - R.
      if (taken_[k]) met.push_back(x[k] / std::max(own - others, hardly_checked * own));
    }
    // The noise of all closures while hardly any was taken, then that of these.
    if (met.size() >= few || noise_ == 0.0) {
      const std::vector<double>& shown = met.size() >= few ? met : misfit_;
      noise_ = noise_scale(shown, static_cast<Index>(shown.size()));
    }
    return true;
  }

  /// Takes the closures that fit, but for new ones whose residual may deviate by more than this,
  /// and leaves those that do not, for as long as the deviation is this one: two that contradict
  /// each other may both fit while neither was taken.
  /// @returns whether any was taken or left
  bool take(double most_deviation) {
    const double most = outlier_noises * outlier_noises * noise_ * noise_;
    bool any = false;
    least_waiting_ = std::numeric_limits<double>::infinity();
    for (std::size_t c = 0; c < closures_.size(); ++c) {
      const Index k = closures_[c];
      const double deviation = noise_ * std::sqrt(variance_[c]);
      const bool fits = misfit_[c] <= most, was = taken_[k];
      const bool now = fits && (was || (deviation <= most_deviation && !was_left_[c]));
      if (fits && !now && deviation > most_deviation) {
        least_waiting_ = std::min(least_waiting_, deviation);
      }
      if (was == now) continue;
      any = true;
      taken_[k] = now;
      was_left_[c] = was;
      closes_cycles_ = true;
    }
    return any;
  }
  /// Before another deviation.
  void look_again() { was_left_.assign(was_left_.size(), false); }
  /// The least deviation of the closures that would fit, and were not taken for its size.
  double least_waiting() const { return least_waiting_; }

 private:
  static constexpr double flops_an_edge = 1e5;
  static constexpr std::size_t few = 10;  // closures
  static constexpr double hardly_checked = 0.1;

  bool goes_on() const { return run_.ended() == Status::not_run && run_.keep_going()(); }

  RobustRun& run_;
  const MeasurementGraph& graph_;
  std::vector<double> precision_;  // (m,), also of trusted edges
  std::vector<bool> taken_;        // (m,)
  std::vector<Index> closures_;    // edges that are neither trusted nor of the tree
  std::vector<std::pair<Index, Index>> ends_;
  Rotations R_;
  bool closes_cycles_ = false;
  // Of the closures, in units of the noise: what is expected of their squared residuals, and these
  // over that; and whether they were left since look_again().
  std::vector<double> variance_, misfit_;
  std::vector<bool> was_left_;
  double noise_ = 0.0, least_waiting_ = 0.0;
};

}  // namespace detail

/// Least squares of edges that bear one another out, from a spanning tree on: from a trajectory's
/// odometry, say. The tree is that of the most precise edges, of trusted ones before all others.
///
/// A measurement between two nodes is tested against what is known of them: its residual has the
/// variance noise^2 (1 / precision + R), where R is the effective resistance between the nodes over
/// the edges that were taken so far. Those are taken first whose deviation is small, as hardly
/// anything wrong passes their test; they stiffen the rest, and others can be told. What was taken
/// is tested again, as an edge like any other.
///
/// @param graph that the run is of
/// @returns nothing where the tree and trusted edges are all, where it would take long, or on being
///        stopped
inline std::optional<Rotations> grown_from_tree(RobustRun& run, const MeasurementGraph& graph) {
  constexpr double first_deviation = 0.05, last_deviation = 0.5;  // chords, radians
  constexpr int most_rounds = 30;
  detail::GrowingPart part(run, graph);
  if (!part.has_closures()) return std::nullopt;
  double most_deviation = first_deviation;
  for (int round = 0; round < most_rounds; ++round) {
    if (!part.test()) return std::nullopt;
    if (part.take(most_deviation)) continue;
    if (!(part.least_waiting() < last_deviation)) break;
    most_deviation = std::min(last_deviation, std::max(2.0 * most_deviation, part.least_waiting()));
    part.look_again();
  }
  return std::move(part).rotations();
}

}  // namespace rotavg

#pragma GCC diagnostic pop

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
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// A spanning tree, and the closures that it bears out.
class GrowingPart {
 public:
  /// @param graph that the run is of
  GrowingPart(RobustRun& run, const MeasurementGraph& graph)
      : run_(run),
        precision_(run.free_precision()),
        max_flops_(flops_an_edge * graph.num_edges()),
        taken_(graph.edges().size(), false) {
    std::vector<double> key = run.given();
    for (std::size_t k = 0; k < key.size(); ++k) {
      if (run.trusts(static_cast<Index>(k))) key[k] *= max_weight * max_weight;  // before others
    }
    const std::vector<Index> tree = maximum_spanning_forest(graph, key, run.keep_going());
    for (const Index k : tree) taken_[k] = true;
    R_ = along_forest(graph, tree);
    for (Index k = 0; k < graph.num_edges(); ++k) {
      if (taken_[k]) continue;
      if (run.trusts(k)) {
        taken_[k] = true;
        ++cycles_;
        continue;
      }
      closures_.push_back(k);
      ends_.emplace_back(graph.edges()[k].i, graph.edges()[k].j);
    }
  }

  bool has_closures() const { return !closures_.empty(); }
  Rotations rotations() && { return std::move(R_); }

  /// Least squares of what was taken, and of every closure its squared residual beside what is
  /// expected of it, in units of the noise.
  /// @returns whether there was time
  bool test() {
    const MeasurementGraph part = run_.part_of(taken_);
    if (cycles_ > 0) R_ = run_.least_squares_of(part, std::move(R_));
    std::vector<double> conductance;
    for (std::size_t k = 0; k < taken_.size(); ++k) {
      if (taken_[k]) conductance.push_back(precision_of(precision_, k));
    }
    const auto resistance = effective_resistances(part, conductance, ends_, max_flops_,
                                                  run_.num_threads(), run_.keep_going());
    if (!resistance || run_.ended() != Status::not_run) return false;
    const std::vector<double>& x = run_.squared_residuals_at(R_);
    variance_.assign(closures_.size(), 0.0);
    misfit_ = variance_;
    for (std::size_t c = 0; c < closures_.size(); ++c) {
      const Index k = closures_[c];
      variance_[c] = 1.0 / precision_of(precision_, k) + (taken_[k] ? 0.0 : (*resistance)[c]);
      misfit_[c] = x[k] / variance_[c];
    }
    double sum = 0.0;
    for (std::size_t k = 0; k < taken_.size(); ++k) {
      if (taken_[k]) sum += precision_of(precision_, k) * x[k];
    }
    if (cycles_ >= few) {
      noise_ = std::sqrt(sum / static_cast<double>(cycles_));
    } else if (noise_ == 0.0) {
      noise_ = noise_scale(misfit_, static_cast<Index>(misfit_.size()));
    }
    noise_ = std::max(noise_, least_noise);
    return true;
  }

  /// Takes the closures that fit, but for new ones whose residual may deviate by more than this,
  /// and leaves those that do not.
  /// @returns whether any was taken or left
  bool take(double most_deviation) {
    const double most = outlier_noises * outlier_noises * noise_ * noise_;
    bool any = false;
    least_waiting_ = std::numeric_limits<double>::infinity();
    for (std::size_t c = 0; c < closures_.size(); ++c) {
      const Index k = closures_[c];
      const double deviation = noise_ * std::sqrt(variance_[c]);
      const bool fits = misfit_[c] <= most, was = taken_[k];
      const bool now = fits && (was || deviation <= most_deviation);
      if (fits && !now) least_waiting_ = std::min(least_waiting_, deviation);
      if (was == now) continue;
      any = true;
      taken_[k] = now;
      cycles_ += now ? 1 : -1;
    }
    return any;
  }
  /// The least deviation of the closures that would fit, and were not taken for its size.
  double least_waiting() const { return least_waiting_; }

 private:
  static constexpr double flops_an_edge = 1e5;
  static constexpr Index few = 10;

  RobustRun& run_;
  const std::vector<double>& precision_;
  double max_flops_;
  std::vector<bool> taken_;      // (m,)
  std::vector<Index> closures_;  // edges that are neither trusted nor of the tree
  std::vector<std::pair<Index, Index>> ends_;
  Rotations R_;
  Index cycles_ = 0;                       // of the edges that were taken
  std::vector<double> variance_, misfit_;  // of the closures
  double noise_ = 0.0, least_waiting_ = 0.0;
};

}  // namespace detail

/// Least squares of edges that bear one another out, from a spanning tree on: from a trajectory's
/// odometry, say. The tree is that of the heaviest edges, of trusted ones before all others.
///
/// A measurement between two nodes is tested against what is known of them: its residual has the
/// variance noise^2 (1 / precision + R), where R is the effective resistance between the nodes over
/// the edges that were taken so far. Those are taken first whose deviation is small, as hardly
/// anything wrong passes their test; they stiffen the rest, and others can be told. What was taken
/// is tested again, as an edge like any other.
///
/// @param graph that the run is of
/// @returns nothing where no edge closes a cycle, where it would take long, or on being stopped
inline std::optional<Rotations> grown_from_tree(RobustRun& run, const MeasurementGraph& graph) {
  constexpr double first_deviation = 0.05, last_deviation = 0.5;  // chords, radians
  constexpr int most_rounds = 24;
  detail::GrowingPart part(run, graph);
  if (!part.has_closures()) return std::nullopt;
  double most_deviation = first_deviation;
  for (int round = 0; round < most_rounds; ++round) {
    if (!part.test()) return std::nullopt;
    if (part.take(most_deviation)) continue;
    if (!(part.least_waiting() < last_deviation)) break;
    most_deviation = std::max(2.0 * most_deviation, part.least_waiting());
  }
  return std::move(part).rotations();
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How much more often right edges turn as far as an edge does than wrong ones do.
///
/// Cameras that match look the same way, more or less: most of the edges that a graph keeps turn by
/// some tens of degrees at most, and what went wrong at random by anything. What is usual is
/// learned from the graph itself, so that where wrong edges turn as right ones do, those of
/// facades that look alike or rotations drawn at random, nothing is said.
class TurnOdds {
 public:
  /// @param right, wrong (m,) edges to learn from
  TurnOdds(const MeasurementGraph& graph, const std::vector<bool>& right,
           const std::vector<bool>& wrong)
      : graph_(&graph) {
    // Shares of both as far as there are few: these tell nothing.
    constexpr double few = 10.0;
    std::array<double, bins> in{}, out{};
    double num_in = 0.0, num_out = 0.0;
    for (Index k = 0; k < graph.num_edges(); ++k) {
      in[bin(k)] += right[k];
      out[bin(k)] += wrong[k];
      num_in += right[k];
      num_out += wrong[k];
    }
    for (std::size_t b = 0; b < bins; ++b) {
      const double both = few * (in[b] + out[b]) / std::max(1.0, num_in + num_out);
      if (both == 0.0) continue;
      log_odds_[b] =
          std::log((in[b] + both) / (num_in + few)) - std::log((out[b] + both) / (num_out + few));
    }
  }

  /// The logarithm of the ratio of the two densities at the turn of an edge.
  double operator()(Index k) const { return log_odds_[bin(k)]; }
  /// How far an edge turns, radians.
  double turn(Index k) const {
    const Vector4 q = graph_->quaternion_edges()[k].i_from_j.coeffs();
    return 2.0 * std::atan2(q.head<3>().norm(), std::abs(q[3]));
  }

 private:
  static constexpr std::size_t bins = 12;  // of 15 degrees

  std::size_t bin(Index k) const {
    constexpr double pi = 3.141592653589793;
    return std::min(bins - 1, static_cast<std::size_t>(turn(k) / pi * bins));
  }

  const MeasurementGraph* graph_;
  std::array<double, bins> log_odds_{};
};

}  // namespace rotavg

#pragma GCC diagnostic pop

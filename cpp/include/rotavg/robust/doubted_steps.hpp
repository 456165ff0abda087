#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/effective_resistance.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/solve/status.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// An answer without some steps of odometry.
struct WithoutSteps {
  Rotations rotations;
  std::vector<bool> given_up;  ///< (m,) the steps
};

/// Least squares of odometry and of the closures that it bears out, without the steps that these
/// contradict: as surveyors look for blunders (Baarda 1968).
///
/// Where one step of many is wrong, least squares spread the error over all of them, and none is
/// conspicuous by its residual r. But the residual of an edge of precision p has the variance
/// noise^2 (1/p - R) alone, R the effective resistance between its ends, and without the edge the
/// sum of squares falls by r^2 / (1/p - R). So the steps whose loss that lowers by more than what
/// giving a step up costs (closures_a_step) are left out, one of a neighbourhood at a time, least
/// squares are solved anew, and closures judged again.
///
/// @param graph that the run is of
/// @param R an answer to begin with
/// @param series (m,) Series::label: of the steps of one, which cannot be told apart, one is left
///        out at a time
/// @param odometry (m,)
/// @param noise radians, of an edge of precision 1
/// @returns nothing where no step is doubted, where it would take long, or on being stopped
inline std::optional<WithoutSteps> without_doubted_steps(
    RobustRun& run, const MeasurementGraph& graph, const std::vector<Index>& series, Rotations R,
    const std::vector<bool>& odometry, double noise) {
  constexpr int most_rounds = 20;
  constexpr double flops_an_edge = 1e5, hardly_checked = 1e-6, nearly_as_doubtful = 0.25;
  constexpr Index neighbourhood = 20;  // nodes, in the order of the graph
  const double outlier = outlier_noises * outlier_noises * noise * noise;
  const auto precision_at = [&](Index k) {
    return std::clamp(precision_of(run.free_precision(), k), min_weight, max_weight);
  };
  std::vector<bool> given_up(odometry.size(), false);
  std::vector<double> weights(odometry.size());
  MeasurementGraph kept = graph;
  bool any = false;
  for (int round = 0; round < most_rounds; ++round) {
    if (run.ended() != Status::not_run || !run.keep_going()()) return std::nullopt;
    const std::vector<double> at_start = run.squared_residuals_at(R);
    std::vector<bool> left_out(odometry.size());
    for (Index k = 0; k < graph.num_edges(); ++k) {
      weights[k] = precision_at(k);
      left_out[k] = odometry[k] ? given_up[k] : at_start[k] * precision_at(k) > outlier;
    }
    leave_out(left_out, weights);
    kept.set_weights(weights);
    R = run.least_squares_of(kept, std::move(R));
    const auto resistance = edge_resistances(kept, flops_an_edge * graph.num_edges(),
                                             run.num_threads(), run.keep_going());
    if (!resistance) return std::nullopt;
    const std::vector<double>& x = run.squared_residuals_at(R);
    std::vector<std::pair<double, Index>> doubted;  // by how much the sum of squares would fall
    for (Index k = 0; k < graph.num_edges(); ++k) {
      const double own = 1.0 / weights[k], variance = own - (*resistance)[k];
      if (!odometry[k] || left_out[k] || variance <= hardly_checked * own) continue;
      const double gain = x[k] / variance;
      if (gain > closures_a_step * outlier) doubted.emplace_back(gain, k);
    }
    if (doubted.empty()) break;
    any = true;
    std::sort(doubted.rbegin(), doubted.rend());
    std::vector<Index> around;  // steps that were given up in this round
    for (const auto& [gain, k] : doubted) {
      if (gain < nearly_as_doubtful * doubted.front().first) break;
      const Index here = graph.edges()[k].i;
      const bool is_near = std::any_of(around.begin(), around.end(), [&, k = k](Index other) {
        return series[other] == series[k] ||
               std::abs(here - graph.edges()[other].i) <= neighbourhood;
      });
      if (is_near) continue;
      around.push_back(k);
      given_up[k] = true;
    }
  }
  if (!any) return std::nullopt;
  return WithoutSteps{std::move(R), std::move(given_up)};
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/edge_support.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the short cycles through an edge say of it: those of three edges, one by every third node,
/// and of two that are parallel (Zach, Klopschitz and Pollefeys 2010).
struct CycleEvidence {
  Index checked = 0;   ///< cycles that were looked at
  Index agreeing = 0;  ///< of these, cycles whose rotations miss the identity by no more than the
                       ///< threshold
  /// The median and the least of the angles, radians, by which they miss it; NaN without cycles.
  double median_error = std::numeric_limits<double>::quiet_NaN();
  double least_error = std::numeric_limits<double>::quiet_NaN();

  /// Whether no cycle agrees, of the many there are: a good edge in a good neighbourhood has one.
  /// @param least how many cycles are enough
  bool refuted(Index least = 3) const { return checked >= least && agreeing == 0; }
  /// (agreeing + 1) / (checked + 2): the share, where there are few cycles near a half.
  double share() const { return (agreeing + 1.0) / (checked + 2.0); }
};

/// The evidence for every edge (m,). Of an edge between well-connected nodes some evenly spread
/// cycles are looked at, at least eight.
///
/// @param threshold radians, of the rotation around the whole cycle
/// @param keep_going asked every few milliseconds; false stops, and there is no evidence on the
/// rest
inline std::vector<CycleEvidence> cycle_evidence(const MeasurementGraph& graph, double threshold,
                                                 const std::function<bool()>& keep_going = {}) {
  constexpr Index edges_between_questions = 1024;
  const Detours detours(graph);
  const double most = 2.0 * std::sin(0.25 * std::min(threshold, 3.141592653589793));
  std::vector<CycleEvidence> evidence(graph.edges().size());
  std::vector<double> distances2;
  for (Index edge = 0; edge < graph.num_edges(); ++edge) {
    if (edge % edges_between_questions == 0 && keep_going && !keep_going()) break;
    CycleEvidence& e = evidence[edge];
    distances2.clear();
    detours.visit(edge, [&](double distance2, double) {
      ++e.checked;
      e.agreeing += distance2 <= most * most;
      distances2.push_back(distance2);
    });
    if (distances2.empty()) continue;
    const auto angle = [](double distance2) {
      return 4.0 * std::asin(std::min(1.0, 0.5 * std::sqrt(distance2)));
    };
    const auto half = distances2.begin() + static_cast<std::ptrdiff_t>(distances2.size() / 2);
    std::nth_element(distances2.begin(), half, distances2.end());
    const double upper = angle(*half);
    const double lower =
        angle(*std::max_element(distances2.begin(), half + (half == distances2.begin())));
    e.median_error = distances2.size() % 2 == 1 ? upper : 0.5 * (lower + upper);
    e.least_error = angle(*std::min_element(distances2.begin(), half + 1));
  }
  return evidence;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

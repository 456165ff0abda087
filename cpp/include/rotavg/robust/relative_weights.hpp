#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The weights (m,) of edges over what is typical of edges that turn as far: the median of a
/// twentieth of them, those with the most similar angles.
///
/// Numbers of matches fall as the view changes, and 1 / sigma^2, which grows with them, falls much
/// faster as the baseline grows: a raw weight mostly says how near two cameras are, or seem to be.
/// What only looks alike matches where it repeats, and nowhere else: less than true neighbours that
/// stand to each other as these two seem to. That is what is left.
/// @param weights (m,), positive
inline std::vector<double> relative_weights(const MeasurementGraph& graph,
                                            const std::vector<double>& weights) {
  constexpr std::size_t most_bins = 20, least_of_a_bin = 10;
  const std::size_t m = weights.size();
  std::vector<std::pair<double, Index>> order(m);  // the squared sine of half the angle
  for (std::size_t k = 0; k < m; ++k) {
    const Vector4 q = graph.quaternion_edges()[k].i_from_j.coeffs();
    order[k] = {q.head<3>().squaredNorm() / q.squaredNorm(), static_cast<Index>(k)};
  }
  std::sort(order.begin(), order.end());
  const std::size_t bins = std::clamp<std::size_t>(m / least_of_a_bin, 1, most_bins);
  std::vector<double> relative = weights, bin;
  for (std::size_t b = 0; b < bins; ++b) {
    const std::size_t first = m * b / bins, last = m * (b + 1) / bins;
    bin.clear();
    for (std::size_t k = first; k < last; ++k) bin.push_back(weights[order[k].second]);
    const auto middle = bin.begin() + static_cast<std::ptrdiff_t>(bin.size() / 2);
    std::nth_element(bin.begin(), middle, bin.end());
    for (std::size_t k = first; k < last; ++k) relative[order[k].second] /= *middle;
  }
  return relative;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

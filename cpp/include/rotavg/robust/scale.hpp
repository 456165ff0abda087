#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// Below this the noise is not told from rounding: 0.006 degrees.
constexpr double least_noise = 1e-4;

/// The standard deviation of the noise angle, in radians, of residuals many of which may be
/// outliers.
///
/// The fixed point s of s = median of the residuals below 3 s, over 0.6724 (the median of half a
/// normal distribution truncated there), that is reached from the tenth of the residuals which are
/// smallest: outliers count only where they are hardly any. (Angles of rotations drawn at random
/// are below 30 degrees in one case of 140.) Residuals of zero, as bridges have them, say nothing;
/// and as n rotations are fitted to the rest, it is scaled by the root of edges / (edges - nodes +
/// components).
///
/// Of many residuals some are taken, evenly spaced; the estimate is then good to a per cent.
///
/// @param x squared residuals
/// @param num_cycles independent cycles of the graph, m - n + components
inline double noise_scale(const std::vector<double>& x, Index num_cycles) {
  constexpr double rounding = 1e-24;
  constexpr double tenth_of_half_normal = 0.1257, median_below_three = 0.6724;
  constexpr std::size_t enough = 20000;
  const std::size_t stride = (x.size() + enough - 1) / enough;
  std::vector<double> r;
  for (std::size_t k = 0; k < x.size(); k += stride) {
    if (x[k] > rounding) r.push_back(std::sqrt(x[k]));
  }
  if (r.empty() || num_cycles <= 0) return least_noise;
  std::sort(r.begin(), r.end());
  double s = r[r.size() / 10] / tenth_of_half_normal;
  for (int k = 0; k < 100; ++k) {
    const auto below = std::upper_bound(r.begin(), r.end(), 3.0 * s) - r.begin();
    const double next =
        r[static_cast<std::size_t>(std::max<std::ptrdiff_t>(below / 2, 0))] / median_below_three;
    const bool same = std::abs(next - s) <= 1e-9 * s;
    s = next;
    if (same) break;
  }
  const double freedom = static_cast<double>(num_cycles) / static_cast<double>(stride * r.size());
  return std::max(least_noise, s / std::sqrt(std::min(1.0, freedom)));
}

}  // namespace rotavg

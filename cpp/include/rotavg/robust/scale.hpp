#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/series.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/radix_sort.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Below this the noise is not told from rounding: 0.006 degrees.
constexpr double least_noise = 1e-4;
/// And above this, radians, most is wrong.
constexpr double most_noise = 0.5;
/// Residuals beyond so many standard deviations are those of outliers.
constexpr double outlier_noises = 3.0;

namespace detail {

/// Of the absolute value of a standard normal number: the tenth of its distribution, ...
constexpr double tenth_of_half_normal = 0.1257;
/// ... and the median of what is below outlier_noises.
constexpr double median_below_three = 0.6724;

}  // namespace detail

/// What every series of edges leaves over, (size,): (sum of r)^2 / sum of 1 / precision, however
/// the edges share it among them. Least squares share it evenly, and a loss that bends off leaves
/// it all to one.
///
/// @param x squared residuals (m,)
/// @param precision (m,) of the edges; empty: all 1. Zero, as of edges that the loss does not
///        touch, counts as 1.
inline std::vector<double> series_residuals(const Series& series, const std::vector<double>& x,
                                            const std::vector<double>& precision) {
  std::vector<double> sum(series.size, 0.0), variance(series.size, 0.0);
  for (std::size_t k = 0; k < x.size(); ++k) {
    const Index s = series.label[k];
    if (s < 0) continue;
    const double p = precision_of(precision, k);
    sum[s] += std::sqrt(x[k]);
    variance[s] += p > 0.0 ? 1.0 / p : 1.0;
  }
  for (Index s = 0; s < series.size; ++s) sum[s] *= sum[s] / variance[s];
  return sum;
}

/// The standard deviation of the noise angle, in radians, of residuals many of which may be
/// outliers.
///
/// The fixed point s of s = median of the residuals below 3 s, over 0.6724 (the median of half a
/// normal distribution truncated there), that is reached from the tenth of the residuals which are
/// smallest: outliers count only where they are hardly any. (Angles of
/// rotations drawn at random are below 30 degrees in one case of 140.) As rotations are fitted to
/// the rest, it is scaled by the root of series / independent cycles.
///
/// Of many residuals some are taken, one of each stretch of the list; the estimate is then good to
/// a per cent.
///
/// @param x squared residuals of the series of the graph (series_residuals)
/// @param num_cycles independent cycles of the graph, m - n + components
inline double noise_scale(const std::vector<double>& x, Index num_cycles) {
  constexpr std::size_t enough = 50000;
  const std::size_t stride = (x.size() + enough - 1) / enough;
  std::vector<double> r;
  for (std::size_t k = 0; k < x.size(); k += stride) {
    // Not always at the same place: lists may have a period.
    const std::size_t length = std::min(stride, x.size() - k);
    r.push_back(std::sqrt(x[k + detail::scrambled(k) % length]));
  }
  if (r.empty() || num_cycles <= 0) return least_noise;
  radix_sort(r);
  double s = std::max(least_noise, r[r.size() / 10] / detail::tenth_of_half_normal);
  for (int k = 0; k < 100; ++k) {
    const auto below = std::upper_bound(r.begin(), r.end(), outlier_noises * s) - r.begin();
    const double next =
        std::max(least_noise, r[static_cast<std::size_t>(below / 2)] / detail::median_below_three);
    const bool same = std::abs(next - s) <= 1e-9 * s;
    s = next;
    if (same) break;
  }
  const double freedom = static_cast<double>(num_cycles) / static_cast<double>(stride * r.size());
  return std::max(least_noise, s / std::sqrt(std::min(1.0, freedom)));
}

/// The same without as many residuals, the smallest, as a spanning tree meets.
inline double noise_off_tree(std::vector<double> x, Index num_cycles) {
  const auto met = static_cast<std::ptrdiff_t>(x.size()) - num_cycles;
  if (met > 0) {
    std::nth_element(x.begin(), x.begin() + met, x.end());
    x.erase(x.begin(), x.begin() + met);
  }
  return noise_scale(x, num_cycles);
}

/// Whether more residuals of series are within so much than a spanning tree can meet: by a fifth,
/// three at least, but by no more than a fifth of the cycles.
inline bool is_met_beyond_tree(const std::vector<double>& x, Index num_cycles, double most) {
  constexpr double of_tree = 0.2, of_cycles = 0.2, few = 3.0;
  const double tree = static_cast<double>(x.size()) - static_cast<double>(num_cycles);
  const auto met =
      std::count_if(x.begin(), x.end(), [=](double x_k) { return x_k <= most * most; });
  const double more =
      std::min(std::max(few, of_tree * tree), of_cycles * static_cast<double>(num_cycles));
  return static_cast<double>(met) >= tree + more;
}

/// The same of rotations that may meet a spanning tree exactly, as those of l1 do where edges are
/// few, and all that were made along one: n - 1 edges met exactly are no sign of little noise.
/// Where hardly any more are within the noise, it is that of the others.
inline double noise_beside_tree(std::vector<double> x, Index num_cycles) {
  const double noise = noise_scale(x, num_cycles);
  const std::ptrdiff_t tree = static_cast<std::ptrdiff_t>(x.size()) - num_cycles;
  if (tree <= 0 || num_cycles <= 0) return noise;
  if (is_met_beyond_tree(x, num_cycles, outlier_noises * noise)) return noise;
  return std::max(noise, noise_off_tree(std::move(x), num_cycles));
}

/// The same where the few that are right among rotations drawn at random show only by their
/// number: of those whose residuals are below r that is greater by the most standard deviations
/// than drawing them all at random would make it, (theta - sin theta) / pi with r = 2 sin(theta/2).
/// For small graphs: large ones have enough residuals that are small.
inline double noise_among_random(std::vector<double> x) {
  constexpr double pi = 3.141592653589793;
  if (x.empty()) return least_noise;
  std::sort(x.begin(), x.end());
  double most = 0.0;
  std::size_t right = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double theta = 2.0 * std::asin(std::min(1.0, 0.5 * std::sqrt(x[k])));
    const double expected = static_cast<double>(x.size()) * (theta - std::sin(theta)) / pi;
    const double excess = (static_cast<double>(k + 1) - expected) / std::sqrt(1.0 + expected);
    if (excess > most) right = k + 1;
    most = std::max(most, excess);
  }
  return std::max(least_noise, std::sqrt(x[right / 2]) / detail::median_below_three);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

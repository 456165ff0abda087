#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/tails.hpp>

namespace rotavg {

/// From where on a residual is that of an outlier, radians.
struct Thresholds {
  double told = 3.141592653589793;                            ///< RobustSolution::threshold
  double doubtful = std::numeric_limits<double>::infinity();  ///< of the verdicts
};

/// How far out from 3 noises residuals become fewer, 20 % of r after 20 %: beyond, more are wrong
/// edges, whatever these have in common, than are tails. Ten noises at most.
/// @param x squared residuals, in units of their precision
inline double end_of_tails(const std::vector<double>& x, double noise) {
  constexpr double step = 1.2, chance = 2.0;  // standard deviations
  constexpr std::size_t bins = 9;  // 3 noises and 1.2^7 times as much, and one on each side
  const double first = outlier_noises * noise / step;
  std::array<double, bins> count{};
  for (const double x_k : x) {
    if (x_k < first * first) continue;
    const auto b = static_cast<std::size_t>(0.5 * std::log(x_k / (first * first)) / std::log(step));
    if (b < bins) count[b] += 1.0;
  }
  double end = outlier_noises * noise;
  for (std::size_t b = 1; b < bins; ++b) {
    if (count[b] > count[b - 1] + chance * std::sqrt(count[b - 1] + 1.0)) break;
    if (b + 1 < bins) end = first * std::pow(step, static_cast<double>(b + 1));
  }
  return end;
}

/// Three times the noise; more where its tails are heavier, as far as they reach, no random
/// rotation is likelier there, and no other wrong edges begin. Of tls its scale.
///
/// @param x squared residuals of the series, in units of their precision
/// @param space Tails::space
inline Thresholds thresholds(const RobustLoss& loss, double noise, const std::vector<double>& x,
                             int space) {
  if (loss.kind == Loss::l2) return {};  // believes everything
  double threshold = loss.kind == Loss::tls ? loss.scale : outlier_noises * noise;
  // Heavy tails reach far; a few residuals do not tell them from outliers.
  constexpr std::size_t few = 100;
  constexpr double most_noises = 10.0;
  if (loss.kind != Loss::tls && x.size() >= few && noise < most_noise) {
    const Tails tails = residual_tails(x, noise, space);
    const double noisy =
        std::min({tails.random_beyond(), tails.reach(x.size()), end_of_tails(x, noise)});
    threshold = std::clamp(noisy, threshold, most_noises * noise);
  }
  // Within a scale that was given, which may be far beyond the noise, most of an edge's weight is
  // left.
  constexpr double most = 0.5;
  if (loss.weight(loss.scale * loss.scale) >= most) threshold = std::max(threshold, loss.scale);
  return {threshold, threshold};
}

}  // namespace rotavg

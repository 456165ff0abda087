#pragma once

#include <algorithm>
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

/// Three times the noise; more where its tails are heavier, as far as they reach, and no random
/// rotation is likelier there. Of tls its scale.
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
    const double noisy = std::min(tails.random_beyond(), tails.reach(x.size()));
    threshold = std::clamp(noisy, threshold, most_noises * noise);
  }
  // Within a scale that was given, which may be far beyond the noise, most of an edge's weight is
  // left.
  constexpr double most = 0.5;
  if (loss.weight(loss.scale * loss.scale) >= most) threshold = std::max(threshold, loss.scale);
  return {threshold, threshold};
}

}  // namespace rotavg

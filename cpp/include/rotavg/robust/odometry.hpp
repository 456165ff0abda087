#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// What contradicts rotations, where some edges are odometry: the sum over all edges of their
/// squared residuals, in units of an outlier's, and one at most; of odometry closures_a_step.
///
/// @param odometry (m,)
/// @param noise radians, of an edge of precision 1
inline double contradictions(RobustRun& run, const Rotations& R, const std::vector<bool>& odometry,
                             double noise) {
  const std::vector<double>& x = run.squared_residuals_at(R);
  const double unit = outlier_noises * outlier_noises * noise * noise;
  double sum = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double most = odometry[k] ? closures_a_step : 1.0;
    sum += std::min(most, x[k] * precision_of(run.free_precision(), k) / unit);
  }
  return sum;
}

/// Whether rotations bend a step of odometry further than noise does, or the noise is so coarse
/// that nothing shows.
inline bool bends_odometry(RobustRun& run, const Rotations& R, const std::vector<bool>& odometry,
                           double noise) {
  constexpr double coarse = 0.1, noises = 5.0;
  if (noise > coarse) return true;
  const std::vector<double>& x = run.squared_residuals_at(R);
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double most = noises * noises * noise * noise;
    if (odometry[k] && x[k] * precision_of(run.free_precision(), k) > most) return true;
  }
  return false;
}

}  // namespace rotavg

#pragma once

#include <algorithm>

#include <rotavg/robust/loss.hpp>

namespace rotavg {

/// How many times the noise the scale of a loss is, by measurement (docs/robust.md): what does well
/// on photographs and in simulations, and loses little where the noise is Gaussian.
///
/// @param freedom Series::freedom. Where it is small, as on trajectories, rotations can be
///        bent to meet many measurements exactly, and a sharply bent loss rewards that.
inline double default_scale(Loss loss, double freedom) {
  constexpr double most = 3.0;
  const double slack = 1.0 / std::max(freedom * freedom, 1e-6);
  switch (loss) {
    case Loss::l1:
      return 0.1;
    case Loss::l_half:
      return std::min(most, 0.3 * slack);
    case Loss::huber:
      return 1.0;
    case Loss::geman_mcclure:
      return 2.0;
    case Loss::tls:
      return 3.0;
    case Loss::cauchy:
    case Loss::l2:
    case Loss::automatic:
      break;
  }
  return std::min(most, 0.4 * slack);
}

}  // namespace rotavg

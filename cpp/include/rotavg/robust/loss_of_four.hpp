#pragma once

#include <rotavg/robust/log1p_of_four.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/so3/lanes.hpp>

namespace rotavg {

/// weight_share() of four edges, in the same arithmetic.
EIGEN_STRONG_INLINE void weight_shares(const RobustLoss& loss, const Lanes& x,
                                       const Lanes& precision, Lanes& share) {
  const Lanes z1 = 1.0 + precision * x * (1.0 / (loss.scale * loss.scale));
  Lanes weight;
  if (loss.kind == Loss::cauchy) {
    weight = 1.0 / z1;
  } else if (loss.kind == Loss::geman_mcclure) {
    weight = 1.0 / (z1 * z1);
  } else {
    for (int a = 0; a < 4; ++a) weight[a] = loss.weight(x[a], precision[a]);
  }
  for (int a = 0; a < 4; ++a) share[a] = least_share(loss, precision[a]);
  share += (1.0 - share) * weight;
}

/// robust_cost() of four edges, but for rounding: its logarithm is another.
EIGEN_STRONG_INLINE void robust_costs(const RobustLoss& loss, const Lanes& x,
                                      const Lanes& precision, Lanes& cost) {
  if (loss.kind != Loss::cauchy) {
    for (int a = 0; a < 4; ++a) cost[a] = robust_cost(loss, x[a], precision[a]);
    return;
  }
  constexpr double tiny = 1e-300;  // without a precision the cost is x
  const double c2 = loss.scale * loss.scale;
  const Lanes units = precision + tiny, z = units * x * (1.0 / c2);
  Lanes rho, share;
  log1p_of_four(z, rho);
  rho *= c2 / units;
  for (int a = 0; a < 4; ++a) {
    share[a] = least_share(loss, precision[a]);
    rho[a] = precision[a] > 0.0 ? rho[a] : x[a];
  }
  cost = rho + share * (x - rho);
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/robust/default_scale.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The robust weights of priors. They are judged by kinds, since a compass and an accelerometer err
/// differently: the noise of each is estimated from its own residuals, as that of the measurements
/// is, in units of the given weights.
class RobustPriors {
 public:
  RobustPriors(const GroundedGraph& problem, const RobustLoss& loss) : loss_(loss) {
    for (const auto& p : problem.priors().absolute) absolute_.given.push_back(p.weight);
    for (const auto& p : problem.priors().gravity) gravity_.given.push_back(p.weight);
    for (Kind* kind : {&absolute_, &gravity_}) {
      kind->verdicts.weights = kind->given;
      kind->verdicts.is_outlier.assign(kind->given.size(), false);
      if (kind->given.empty()) continue;
      std::vector<double> sorted = kind->given;
      const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
      std::nth_element(sorted.begin(), middle, sorted.end());
      for (const double w : kind->given) kind->precision.push_back(w / *middle);
    }
  }

  /// Weighs the priors anew by what rotations R (n,), world_from_node, leave over of them.
  /// @param rough whether most may still be wrong: by the loss l1, which does not care
  /// @returns the largest change of a robust weight
  double update(const GroundedGraph& problem, const Rotations& R, bool rough) {
    const PriorResiduals angles = prior_residuals(problem, R);
    return std::max(update(absolute_, angles.absolute, rough),
                    update(gravity_, angles.gravity, rough));
  }

  const PriorVerdicts& absolute() const { return absolute_.verdicts; }
  const PriorVerdicts& gravity() const { return gravity_.verdicts; }

 private:
  struct Kind {
    std::vector<double> given, precision;
    PriorVerdicts verdicts;
  };

  double update(Kind& kind, const std::vector<double>& angles, bool rough) const {
    constexpr double rough_scale = 0.01;
    std::vector<double> x, judged;
    for (std::size_t k = 0; k < angles.size(); ++k) {
      const double chord = 2.0 * std::sin(0.5 * angles[k]);
      x.push_back(chord * chord);
      judged.push_back(kind.precision[k] * x[k]);
    }
    PriorVerdicts& verdicts = kind.verdicts;
    verdicts.noise = noise_scale(judged, static_cast<Index>(x.size()));
    verdicts.threshold = outlier_noises * verdicts.noise;
    RobustLoss loss = loss_;
    loss.scale = default_scale(loss.kind, 1.0) * verdicts.noise;
    if (rough) loss = {Loss::l1, rough_scale};
    double change = 0.0;
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double share =
          std::max(least_weight_share, weight_share(loss, x[k], kind.precision[k]));
      change = std::max(change, std::abs(share - verdicts.weights[k] / kind.given[k]));
      verdicts.weights[k] = std::max(min_weight, share * kind.given[k]);
      verdicts.is_outlier[k] = judged[k] > verdicts.threshold * verdicts.threshold;
    }
    return change;
  }

  RobustLoss loss_;
  Kind absolute_, gravity_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

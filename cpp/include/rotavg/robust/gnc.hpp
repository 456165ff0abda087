#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/irls.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/status.hpp>

namespace rotavg {

/// The surrogates of a bounded loss, from one that bends off slowly and is level only some four
/// scales out, or a few degrees where the scale is less, towards the loss itself: graduated
/// non-convexity (Blake and Zisserman 1987; Yang, Antonante, Tzoumas and Carlone 2020, who also
/// step mu by 1.4).
inline std::vector<RobustLoss> graduation(const RobustLoss& loss) {
  constexpr double step = 1.4, scales2 = 16.0, rough = 0.02;
  const double reach2 = std::max(scales2, rough * rough / (loss.scale * loss.scale));
  std::vector<RobustLoss> surrogates;
  for (double mu = reach2; mu > 1.0; mu /= step) {
    RobustLoss surrogate = loss;
    if (loss.kind == Loss::geman_mcclure) {
      surrogate.scale *= std::sqrt(mu);  // mu c^2 x / (mu c^2 + x)
    } else if (loss.kind == Loss::tls) {
      surrogate.mu = 2.0 / mu;
    } else {
      break;
    }
    surrogates.push_back(surrogate);
  }
  return surrogates;
}

/// Graduated non-convexity: two reweightings for each surrogate, or one where it gains little, each
/// from where the last one ended. While it lasts, the objective of the loss itself may rise;
/// what is reported is that of the surrogate. Losses that are not bounded have no surrogates.
///
/// @returns rotations from which irls() may go on, and how many reweightings were made
inline IterationResult gnc(const MeasurementGraph& graph, const Rotations& R,
                           const RobustLoss& loss, const std::vector<double>& precision,
                           const InnerSteps& inner, const IterationOptions& options) {
  constexpr int reweightings = 2;
  constexpr double little = 1e-3;  // of the objective
  Quaternions q = to_quaternions(R);
  RobustResiduals residuals(graph, precision,
                            resolve_num_threads(options.num_threads, graph.num_edges()));
  IterationResult result;
  for (const RobustLoss& surrogate : graduation(loss)) {
    IterationOptions rest = remaining(options, result);
    rest.max_iterations = std::min(rest.max_iterations, reweightings);
    Monitor monitor(graph, R, rest);
    residuals.update(q, surrogate);
    reweight(residuals, q, inner, little, monitor);
    const IterationResult ended = std::move(monitor).result({});
    result.iterations += ended.iterations;
    result.seconds += ended.seconds;
    result.status = ended.status;
    if (result.status == Status::stopped || result.status == Status::time_limit) break;
  }
  result.rotations = to_rotations(q, R);
  return result;
}

}  // namespace rotavg

#pragma once

#include <cmath>
#include <utility>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/relaxation.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// Block coordinate descent on the semidefinite relaxation (6): the baseline that the paper
/// compares with (Eriksson, Olsson, Kahl and Chin 2018, "Rotation averaging and strong duality",
/// Algorithm 1). One iteration is a sweep over all block rows, each with the newest values of the
/// others; the rotations come from the first block row of Y.
///
/// It minimises over n^2 blocks what BCD minimises over n: an iteration takes 54 n m multiply-adds
/// for m edges (27 n^3 on a complete graph), and Y takes 72 n^2 bytes.
///
/// The objective in the trace is that of (6), 6 sum w - tr(Rt Y), which falls at every step; f of
/// the result is that of its rotations. Gradients are those of f at the rotations, the step is
/// |Y - Y'| / |Y|. Where Y has settled, the iteration ends whatever the stopping rule: if the
/// relaxation is not tight, its rotations need not be stationary.
///
/// @param R the initial value, world_from_i, one rotation per node; Y starts from (I + R^T R) / 2
/// @throws TooLarge if Y does not fit in memory
inline IterationResult bcdsr(const MeasurementGraph& graph, const Rotations& R,
                             const IterationOptions& options = {}) {
  Monitor monitor(graph, R, options);
  const int num_threads = monitor.num_threads();
  const Components components = connected_components(graph);
  SemidefiniteRelaxation relaxation(graph, R, num_threads);
  Rotations rounded = relaxation.rotations(components);
  double step = 0.0;
  bool settled = false;
  while (!monitor.should_stop(relaxation.objective(), gradient_norm(graph, rounded, num_threads),
                              step, settled)) {
    double change = 0.0;
    for (Index k = 0; k < graph.num_nodes() && monitor.keep_going(); ++k) {
      change += relaxation.minimize_block(k);
    }
    rounded = relaxation.rotations(components);
    step = std::sqrt(change) / relaxation.matrix().norm();
    settled = step <= 0.01 * options.tolerance;
  }
  IterationResult result = std::move(monitor).result(std::move(rounded));
  result.objective = objective(graph, result.rotations, num_threads);
  return result;
}

}  // namespace rotavg

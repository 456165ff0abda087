#pragma once

#include <cmath>
#include <utility>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// One sweep of Algorithm 2 over all nodes, in place, each with the newest values of the others.
/// @returns the paper's measure of the step, sum_l |R_l - R_l'| / |R_l|
inline double bcd_sweep(const AnisotropicGraph& graph, Rotations& R, const Monitor& monitor) {
  constexpr Index nodes_between_questions = 4096;
  double step = 0.0;
  for (Index l = 0; l < graph.num_nodes(); ++l) {
    if (graph.row(l).size() == 0) continue;                   // any rotation is optimal
    const Matrix3 R_l = loso_fast(linear_cost(graph, R, l));  // (10), (11), Algorithm 1
    step += (R_l - R[l]).norm() / std::sqrt(3.0);
    R[l] = R_l;
    if (l % nodes_between_questions == 0 && !monitor.keep_going()) break;
  }
  return step;
}

inline double bcd_sweep(const AnisotropicGraph& graph, Quaternions& q, const Monitor& monitor) {
  Rotations R = to_rotations(q);
  const double step = bcd_sweep(graph, R, monitor);
  q = to_quaternions(R);
  return step;
}

/// Block coordinate descent (Algorithm 2) on general blocks: with all other rotations fixed, f is
/// linear in R_l whatever the blocks are, and LOSO minimises it. See solve/bcd.hpp.
///
/// @param R the initial value, world_from_i, one rotation per node
inline IterationResult bcd(const AnisotropicGraph& graph, Rotations R,
                           const IterationOptions& options = {}) {
  Monitor monitor(graph.scalar(), R, options);
  AnisotropicResiduals residuals(graph, to_quaternions(R), monitor.num_threads());
  double step = 0.0;
  while (!monitor.should_stop(residuals.objective(), residuals.gradient_norm(), step)) {
    step = bcd_sweep(graph, R, monitor);
    residuals.update(to_quaternions(R));
  }
  return std::move(monitor).result(std::move(R));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <utility>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// Block coordinate descent (Algorithm 2). With all other rotations fixed, the objective (8) is
/// linear in R_l, -tr(R Rt R^T) = 2 tr(A_l R_l) + const (10), (11), and LOSO minimises it exactly.
/// One iteration is a sweep over all nodes. The objective falls with every block, and every limit
/// point is stationary.
///
/// Each A_l uses the newest values, including those of the running sweep. (The paper's listing
/// names R^(t-1) for all k, which would be Jacobi's method and need not descend.) A sweep is
/// serial.
///
/// @param R the initial value, world_from_i, one rotation per node
inline IterationResult bcd(const MeasurementGraph& graph, Rotations R,
                           const IterationOptions& options = {}) {
  Monitor monitor(graph, R, options);
  constexpr Index nodes_between_questions = 4096;  // a sweep of a large graph takes a second
  double step = 0.0;
  while (!monitor.should_stop(R, objective(graph, R, monitor.num_threads()), step)) {
    step = 0.0;
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      if (graph.row(l).size() == 0) continue;        // nothing is measured: any rotation is optimal
      const Matrix3 A_l = linear_cost(graph, R, l);  // (10)
      const Matrix3 R_l = loso_fast(A_l);            // (11), Algorithm 1
      step += (R_l - R[l]).norm() / R_l.norm();
      R[l] = R_l;
      if (l % nodes_between_questions == 0 && !monitor.keep_going()) break;
    }
  }
  return std::move(monitor).result(std::move(R));
}

}  // namespace rotavg

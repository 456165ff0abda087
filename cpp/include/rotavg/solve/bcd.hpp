#pragma once

#include <cmath>
#include <optional>
#include <utility>

#include <rotavg/graph/coloring.hpp>
#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/loso_quaternion.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

enum class SweepOrder { rising, falling };

/// One sweep of block coordinate descent over all nodes, in place, each with the newest values of
/// the others. Ends early where the monitor does not let it go on.
///
/// @tparam Rows MeasurementGraph or, for many sweeps, HalfEdgeRows
/// @returns the paper's measure of the step, sum_l |R_l - R_l'| / |R_l|
template <typename Rows>
double bcd_sweep(const Rows& rows, Quaternions& q, const Monitor& monitor,
                 SweepOrder order = SweepOrder::rising) {
  constexpr Index nodes_between_questions = 4096;  // a sweep of a large graph takes a second
  const Index n = rows.num_nodes();
  double step = 0.0;
  for (Index k = 0; k < n; ++k) {
    const Index l = order == SweepOrder::rising ? k : n - 1 - k;
    if (k + 1 < n) prefetch_row(rows, q, order == SweepOrder::rising ? l + 1 : l - 1);
    if (rows.row(l).size() == 0) continue;             // any rotation is optimal
    const Matrix4 K_l = davenport_matrix(rows, q, l);  // (10)
    const Quaternion q_l = loso(K_l, q[l]);            // (11), Algorithm 1
    step += chordal_distance(q_l, q[l]) / std::sqrt(3.0);
    q[l] = q_l;
    if (k % nodes_between_questions == 0 && !monitor.keep_going()) break;
  }
  return step;
}

/// The same by colours: the nodes of one at once, which gives what one after the other would.
template <typename Rows>
double bcd_sweep(const Rows& rows, const Coloring& coloring, Quaternions& q, const Monitor& monitor,
                 SweepOrder order = SweepOrder::rising) {
  constexpr double work_of_loso = 300.0;
  const double work =
      work_of_pass * 2.0 * rows.num_edges() + work_of_loso * rows.num_nodes();  // of all colours
  double step = 0.0;
  for (Index k = 0; k < coloring.num_colors() && monitor.keep_going(); ++k) {
    const Index c = order == SweepOrder::rising ? k : coloring.num_colors() - 1 - k;
    const Index* const nodes = coloring.node.data() + coloring.start[c];
    const Index size = coloring.start[c + 1] - coloring.start[c];
    const double share = static_cast<double>(size) / rows.num_nodes();
    const int num_threads = threads_for(monitor.num_threads(), share * work);
    step += block_sum<double>(size, num_threads, [&](Index a) {
      const Index l = nodes[a];
      if (a + 1 < size) prefetch_row(rows, q, nodes[a + 1]);
      if (rows.row(l).size() == 0) return 0.0;
      const Quaternion q_l = loso(davenport_matrix(rows, q, l), q[l]);  // (10), (11)
      const double distance = chordal_distance(q_l, q[l]) / std::sqrt(3.0);
      q[l] = q_l;
      return distance;
    });
  }
  return step;
}

/// Block coordinate descent (Algorithm 2). With all other rotations fixed, the objective (8) is
/// linear in R_l, -tr(R Rt R^T) = 2 tr(A_l R_l) + const (10), (11), and LOSO minimises it. One
/// iteration is a sweep over all nodes. The objective falls with every block, and every limit point
/// is stationary where the blocks' minima are unique.
///
/// Each A_l uses the newest values, including those of the running sweep. (The paper's listing
/// names R^(t-1) for all k, which would be Jacobi's method and need not descend.) A sweep is
/// serial, but by colours.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param coloring of the nodes, in whose order sweeps go; by default they go in that of the nodes
inline IterationResult bcd(const MeasurementGraph& graph, const Rotations& R,
                           const IterationOptions& options = {},
                           const Coloring* coloring = nullptr) {
  Monitor monitor(graph, R, options);
  Quaternions q = to_quaternions(R);
  ResidualQuaternions residuals(graph, q, monitor.num_threads());
  std::optional<HalfEdgeRows> rows;  // not made where there is nothing to do
  double step = 0.0;
  while (!monitor.should_stop(residuals.objective(), residuals.gradient_norm(), step)) {
    if (!rows) rows.emplace(graph, coloring ? &coloring->node : nullptr, monitor.num_threads());
    step = coloring ? bcd_sweep(*rows, *coloring, q, monitor) : bcd_sweep(*rows, q, monitor);
    residuals.update(q);
  }
  return std::move(monitor).result(to_rotations(q, R));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

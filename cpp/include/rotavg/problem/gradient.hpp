#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The paper's A_l (10), so that tr(A_l R_l) is the part of -tr(R Rt R^T) / 2 that depends on R_l:
///
///     A_l = - sum_{(l,q)} w R_lq R_q^T - sum_{(p,l)} w R_pl^T R_p^T = - sum_q Rt_lq R_q^T.
///
/// (The paper prints R_p where R_p^T belongs.)
inline Matrix3 linear_cost(const MeasurementGraph& graph, const Rotations& R, Index l) {
  Matrix3 A = Matrix3::Zero();
  for (const HalfEdge& h : graph.row(l)) {
    A.noalias() -= graph.block(h) * R[h.node].transpose();
  }
  return A;
}

/// The gradient of f at node l in the global frame: the derivative of f along R_l <- exp(w) R_l at
/// w = 0, given A_l. From f = const + 2 tr(A_l R_l) and tr([w] X) = -w . vee(X - X^T).
inline Vector3 gradient_from_linear_cost(const Matrix3& A_l, const Matrix3& R_l) {
  return -2.0 * vee_difference(R_l * A_l);
}

/// The Riemannian gradient of (3): one vector per node, g_l = d f(exp(w_l) R_l) / d w_l at w = 0.
inline std::vector<Vector3> gradient(const MeasurementGraph& graph, const Rotations& R,
                                     int num_threads = 1) {
  std::vector<Vector3> g(R.size());
  parallel_for(graph.num_nodes(), num_threads,
               [&](Index l) { g[l] = gradient_from_linear_cost(linear_cost(graph, R, l), R[l]); });
  return g;
}

/// Size of a gradient, absolutely and relative to the graph.
struct GradientNorm {
  double absolute = 0.0;  ///< |g|_2 over all nodes, in units of the objective per radian
  /// max |g_l| / deg_l, in radians: about four times the angle by which some node would turn if the
  /// others stood still. The same when all weights of a component are scaled.
  double relative = 0.0;
};

/// The sum of squares and the maximum behind a GradientNorm.
struct GradientSums {
  double squares = 0.0;
  double largest = 0.0;
  GradientSums& operator+=(const GradientSums& other) {
    squares += other.squares;
    if (!(other.largest <= largest)) largest = other.largest;  // a NaN stays
    return *this;
  }
};

inline GradientNorm gradient_norm(const MeasurementGraph& graph, const Rotations& R,
                                  int num_threads = 1) {
  const auto at_node = [&](Index l) {
    if (graph.row(l).size() == 0) return GradientSums{};
    const double square = gradient_from_linear_cost(linear_cost(graph, R, l), R[l]).squaredNorm();
    return GradientSums{square, std::sqrt(square) / graph.degree(l)};
  };
  const auto sums = block_sum<GradientSums>(graph.num_nodes(), num_threads, at_node);
  return {std::sqrt(sums.squares), sums.largest};
}

}  // namespace rotavg

#pragma GCC diagnostic pop

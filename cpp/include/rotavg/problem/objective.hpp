#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What an edge leaves over: R_i R_ij - R_j.
inline Matrix3 residual(const Edge& e, const Rotations& R) {
  return product(R[e.i], e.i_from_j()) - R[e.j];
}

/// The objective (3): f(R) = sum_E w_ij |R_i R_ij - R_j|_F^2, summed edge by edge, so that a
/// noiseless graph gives zero to the square of the rounding error, which 6 sum w - tr(R Rt R^T)
/// (20) would not.
inline double objective(const MeasurementGraph& graph, const Rotations& R, int num_threads = 1) {
  const auto& edges = graph.edges();
  return block_sum<double>(graph.num_edges(), num_threads, [&](Index k) {
    const Edge& e = edges[k];
    return e.weight * residual(e, R).squaredNorm();
  });
}

/// How much rounding can move a computed objective: two values closer than this are equal.
/// Each residual carries an error of a few epsilon, |f - f~| <= 2 sum w |D| |dD| (Cauchy-Schwarz).
inline double objective_rounding(double total_weight, double objective) {
  constexpr double error = 16.0 * std::numeric_limits<double>::epsilon();
  const double f = std::max(objective, 0.0);  // rounding may have taken it below; NaN stays
  return error * (std::sqrt(total_weight * f) + error * total_weight);
}
inline double objective_rounding(const MeasurementGraph& graph, double objective) {
  return objective_rounding(graph.total_weight(), objective);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cstddef>
#include <stdexcept>
#include <vector>

#include <rotavg/problem/check_precisions.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What measurements with full covariances need to know besides a GroundedGraph, whose weights of
/// measurements do not count then.
struct GroundedPrecisions {
  std::vector<Matrix3> measurements;  ///< (m,) of the given ones, each in the frame of its j
  /// Radians^-2, of a prior of weight 1: its precision about every axis or, of gravity, about those
  /// at right angles to down.
  double prior = 1.0;
};

/// The precisions of the edges of problem.graph(). What rides turns them with it. Gravity knows
/// nothing about the axis g, and of the rest each of its two edges (reduction/gravity.hpp) would do
/// alone: 4 v^T H v with H = w (I - g g^T) is w |R_i d - g|^2, without any constant.
///
/// @param of_second the share of the second edges
/// @throws InvalidEdge for a precision that is not finite, symmetric and positive semidefinite
/// @throws std::invalid_argument unless there is one for each given measurement, and for a
///         precision of priors that is negative or no number
inline std::vector<Matrix3> precisions_of_edges(const GroundedGraph& problem,
                                                const GroundedPrecisions& precisions,
                                                double of_second = 0.5) {
  const auto& given = problem.given().edges();
  const auto& edges = problem.graph().edges();
  const std::vector<Matrix3> measured =
      checked_precisions(problem.given().num_edges(), precisions.measurements, "precisions");
  if (!(precisions.prior >= 0.0 && precisions.prior <= max_weight)) {
    throw std::invalid_argument("found " + six_digits(precisions.prior) +
                                " for the precision of priors; expected a number between 0 and " +
                                six_digits(max_weight));
  }
  std::vector<Matrix3> result;
  result.reserve(edges.size());
  for (const Index k : problem.kept()) {
    const Matrix3& C_j = problem.riding().variable_from_node[given[k].j];
    result.push_back(product_transposed(product(C_j, measured[k]), C_j));
  }
  for (std::size_t k = result.size(); k < edges.size(); ++k) {
    result.push_back(multiple_of_identity(precisions.prior * edges[k].weight));
  }
  const Vector3& g = problem.gravity().down;
  Matrix3 across = outer_product(Vector3(-g), g);
  add_to_diagonal(across, 1.0);
  for (const Index first : problem.gravity().first) {
    const double h = precisions.prior * edges[first].weight;
    result[first] = (1.0 - of_second) * h * across;
    result[first + 1] = of_second * h * across;
  }
  return result;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

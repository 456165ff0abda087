#pragma once

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// The unit vector with the least sum of w |u - d| over directions d, by reweighting (Weiszfeld
/// 1937): half of them may be anywhere.
inline Vector3 median_direction(const std::vector<Vector3>& directions,
                                const std::vector<double>& weights) {
  constexpr double rounded = 1e-3;  // below it, a residual counts as its square
  constexpr int max_steps = 50;
  constexpr double settled = 1e-9;
  Vector3 mean = Vector3::Zero();
  for (std::size_t k = 0; k < directions.size(); ++k) mean += weights[k] * directions[k];
  if (mean.isZero(0.0)) return directions.front();
  mean.normalize();
  for (int k = 0; k < max_steps; ++k) {
    Vector3 next = Vector3::Zero();
    for (std::size_t a = 0; a < directions.size(); ++a) {
      next += weights[a] / std::max(rounded, (directions[a] - mean).norm()) * directions[a];
    }
    if (next.isZero(0.0)) break;
    next.normalize();
    const double step = (next - mean).norm();
    mean = next;
    if (step <= settled) break;
  }
  return mean;
}

}  // namespace detail

/// The direction of gravity at every node, estimated anew from its own and those of its neighbours,
/// R_ij d_j: what most of them say, by weight, so that single wrong directions and edges do not
/// count. A node's own direction weighs as much as its heaviest edge. No absolute rotation is
/// needed.
///
/// @param down (n,) in the frame of every node, of any length; zero where it is not known
/// @param rounds how often, each from the directions that the last one found
/// @returns (n,) of length 1; zero at nodes that have no direction, nor neighbours with one
/// @throws std::invalid_argument unless there is a finite direction for every node
inline std::vector<Vector3> refined_gravity(const MeasurementGraph& graph,
                                            std::vector<Vector3> down, int rounds = 2) {
  if (down.size() != graph.nodes().size()) {
    throw std::invalid_argument("expected a direction of gravity for every node");
  }
  for (Vector3& d : down) {
    if (!is_finite(d)) throw std::invalid_argument("a direction of gravity is not finite");
    if (!d.isZero(0.0)) d = unit_direction(d);
  }
  std::vector<Vector3> directions;
  std::vector<double> weights;
  for (int k = 0; k < rounds; ++k) {
    std::vector<Vector3> next = down;
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      directions.clear();
      weights.clear();
      double heaviest = 0.0;
      for (const HalfEdge& h : graph.row(i)) {
        if (down[h.node].isZero(0.0)) continue;
        const Edge& e = graph.edges()[h.edge()];
        const Matrix3 i_from_node = h.is_i() ? e.i_from_j() : Matrix3(e.i_from_j().transpose());
        directions.push_back(i_from_node * down[h.node]);
        weights.push_back(e.weight);
        heaviest = std::max(heaviest, e.weight);
      }
      if (directions.empty()) continue;
      if (!down[i].isZero(0.0)) {
        directions.push_back(down[i]);
        weights.push_back(heaviest);
      }
      next[i] = detail::median_direction(directions, weights);
    }
    down = std::move(next);
  }
  return down;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

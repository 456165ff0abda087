#pragma once

#include <algorithm>
#include <vector>

#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Turns every component of the measurements as a whole to where it meets its priors best: by the
/// rotation next to sum of w P R^T + 2 w g (R d)^T (Arun, Huang and Blostein 1987). Fixed rotations
/// count a thousand times the largest weight.
///
/// @param label (n,) of the component of every given node where priors are left out
/// @param R (n,) world_from_node of the given nodes, each component in a world of its own
inline Rotations aligned_with_priors(const GroundedGraph& problem, const std::vector<Index>& label,
                                     Rotations R) {
  const CheckedPriors& priors = problem.priors();
  double firm = problem.given().max_weight();
  for (const auto& p : priors.absolute) firm = std::max(firm, p.weight);
  for (const auto& p : priors.gravity) firm = std::max(firm, p.weight);
  firm *= 1e3;
  Index num_components = 0;
  for (const Index c : label) num_components = std::max(num_components, c + 1);
  Rotations profile(static_cast<std::size_t>(num_components), Matrix3::Zero());
  const auto add = [&](const CheckedPriors::Rotation& p, double weight) {
    profile[label[p.node]] += weight * product_transposed(p.world_from_node, R[p.node]);
  };
  for (const auto& p : priors.fixed) add(p, firm);
  for (const auto& p : priors.absolute) add(p, p.weight);
  for (const auto& p : priors.gravity) {
    profile[label[p.node]] += 2.0 * p.weight * outer_product(priors.down, R[p.node] * p.down);
  }
  for (Matrix3& turn : profile) {
    turn = turn.isZero(0.0) ? Matrix3(Matrix3::Identity()) : nearest_rotation(turn);
  }
  for (std::size_t i = 0; i < R.size(); ++i) R[i] = profile[label[i]] * R[i];
  return R;
}

/// Where the heading is free, turns about down so that the first variable of each part is as near
/// to the identity as it can be. The objective does not change.
inline Rotations headed(const GroundedGraph& problem, Rotations Q) {
  const std::vector<Index>& part = problem.free_heading();
  Rotations turn(static_cast<std::size_t>(problem.num_free_headings()), Matrix3::Zero());
  for (std::size_t v = 0; v < Q.size(); ++v) {
    if (part[v] < 0) continue;
    Matrix3& about_down = turn[part[v]];
    if (about_down.isZero(0.0)) about_down = heading_to_identity(Q[v], problem.priors().down);
    Q[v] = about_down * Q[v];
  }
  return Q;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_set>
#include <utility>
#include <vector>

#include <rotavg/online/tended_core.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// What an edge that would close a cycle costs, before it is used.
struct Closing {
  double least_cost;     ///< f* with the edge is above f(R) of now by this at least
  double squared_chord;  ///< what would be left of its residual: r^2 of RobustLoss, about
};

namespace detail {

/// The weights of the edges between a hanging node and what it rides on, in series: 1 / w summed
/// up.
inline double slack_between(const Core& core, Index i, Index j) {
  std::unordered_set<Index> edges;  // what both ways have in common counts for neither
  for (Index at : {i, j}) {
    for (; core.node(at).kind == NodeKind::hanging; at = core.node(at).anchor) {
      const Index k = core.node(at).anchor_edge;
      if (!edges.insert(k).second) edges.erase(k);
    }
  }
  double slack = 0.0;
  for (const Index k : edges) slack += 1.0 / core.graph().edge(k).weight;
  return slack;
}

}  // namespace detail

/// Foretells what closing a cycle costs. With N_i = R_i^T, S of the factor, and B X = X_i - R_ij
/// X_j, the cost of any rotations R + Z is at least that of S, a quadratic function of N + Z; so
/// with D = B N, K = S N and y = L^-1 K
///
///     f*(with the edge) - f(R) + |y|^2  >=  min over Z of |L^T Z + y|^2 + w |D + B Z|^2
///                                       >=  (sqrt(tr D^T (I / w + B S^-1 B^T)^-1 D) - |y|)^2.
///
/// @param e between nodes of one component, not yet in use
/// @param gap of the component by its factor, |y|^2
/// @returns nothing where the nodes are not in the factor
inline std::optional<Closing> foretell(TendedCore& tended, const OnlineEdge& e, double gap) {
  const Core& core = tended.core;
  Matrix3 i_from_j = weighted_rotation(e.i_from_j);
  i_from_j /= e.i_from_j.squaredNorm();
  std::vector<std::pair<Index, Matrix3>> ends;  // B^T
  const auto add_end = [&](Index i, Matrix3 block) {
    const OnlineNode& node = core.node(i);
    const bool rides = node.kind == NodeKind::hanging;
    const Index base = rides ? node.base : i;
    if (core.node(base).kind == NodeKind::ground) return;
    if (rides) block = product(node.q.toRotationMatrix(), block);
    for (auto& [other, sum] : ends) {
      if (other == base) return add(sum, block);
    }
    ends.emplace_back(base, block);
  };
  add_end(e.i, Matrix3::Identity());
  add_end(e.j, -transposed(i_from_j));
  for (const auto& [base, block] : ends) {
    if (!tended.tree.is_solved(base)) return std::nullopt;
  }
  Matrix3 A = tended.tree.compliance(ends);
  add_to_diagonal(A, 1.0 / e.given + detail::slack_between(core, e.i, e.j));

  const Matrix3 R_i = core.rotation(e.i).toRotationMatrix();
  const Matrix3 R_j = core.rotation(e.j).toRotationMatrix();
  Matrix3 D = product_transposed(i_from_j, R_j);
  for (int k = 0; k < 9; ++k) D(k) = transposed(R_i)(k) - D(k);
  const double size = A(0, 0) + A(1, 1) + A(2, 2);
  A /= size;
  const Vector3 a = A.col(0), b = A.col(1), c = A.col(2);
  const double det = dot(a, cross(b, c));
  if (!(det > 0.0) || !std::isfinite(size)) return std::nullopt;
  Matrix3 inverse;
  inverse.row(0) = cross(b, c).transpose();
  inverse.row(1) = cross(c, a).transpose();
  inverse.row(2) = cross(a, b).transpose();
  inverse /= det * size;
  const Matrix3 force = product(inverse, D);
  double cost = 0.0, left = 0.0;
  for (int k = 0; k < 9; ++k) {
    cost += D(k) * force(k);
    left += force(k) * force(k);
  }
  const double root = std::max(std::sqrt(std::max(cost, 0.0)) - std::sqrt(gap), 0.0);
  return Closing{root * root - gap, 0.5 * left / (e.given * e.given)};
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
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

/// The sum of 1 / w along the hanging paths of two nodes, without what they share.
inline double slack_between(const Core& core, Index i, Index j) {
  const auto path_of = [&](Index at) {
    std::vector<Index> edges;
    for (; core.node(at).kind == NodeKind::hanging; at = core.node(at).anchor) {
      edges.push_back(core.node(at).anchor_edge);
    }
    return edges;
  };
  std::vector<Index> of_i = path_of(i), of_j = path_of(j);
  while (!of_i.empty() && !of_j.empty() && of_i.back() == of_j.back()) {
    of_i.pop_back();
    of_j.pop_back();
  }
  double slack = 0.0;
  for (const auto* path : {&of_i, &of_j}) {
    for (const Index k : *path) slack += 1.0 / core.graph().edge(k).weight;
  }
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
  const Matrix3 i_from_j = e.rotation();
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

  const Matrix3 i_from_world = transposed(core.rotation(e.i).toRotationMatrix());
  Matrix3 D = product_transposed(i_from_j, core.rotation(e.j).toRotationMatrix());
  for (int k = 0; k < 9; ++k) D(k) = i_from_world(k) - D(k);
  const double size = A(0, 0) + A(1, 1) + A(2, 2);
  A /= size;
  const double det = determinant(A);
  if (!(det > 0.0) || !std::isfinite(size)) return std::nullopt;
  Matrix3 inverse = adjugate(A);
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

#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/online/clique.hpp>
#include <rotavg/online/growing_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What a node of a graph that grows is.
enum class NodeKind {
  ground,   ///< the one of its component that is held
  hanging,  ///< it meets its edges exactly: a tree of edges hangs from the core, or from the ground
  core,     ///< it lies on a cycle, or between those that do, or did
};

struct OnlineNode {
  NodeKind kind = NodeKind::ground;
  Quaternion q = Quaternion::Identity();  ///< world_from_i; of a hanging node base_from_i
  Index base = -1;         ///< of a hanging node: the node of the core, or ground, that it rides on
  Index anchor = -1;       ///< of a hanging node: the next one on the way there,
  Index anchor_edge = -1;  ///< and the edge
  Index component = -1;
  // Of the edges of the core, in the frame of the node:
  double degree = 0.0;
  Index num_edges = 0;
  Matrix3 less = Matrix3::Zero();  ///< Lambda = deg I - less; sum 2 (|v|^2 I - v v^T)
  Vector3 turn = Vector3::Zero();  ///< sum 2 s v: the gradient is four times as long
  Matrix3 dual = Matrix3::Zero();  ///< `less` as it stands in the factorised matrix
};

/// The core of a graph that grows: S = Lambda - Rt (Theorem 1), the ground left out, with
///
///     S_ii = deg_i I - dual_i,     S_ij = -Rt_ij,
///
/// in the frames of the nodes, where rotations that change leave Rt as it is: S changes where edges
/// come and go, and where `dual` follows the rotations. It need not, to be a proof
/// (online_impl.hpp). K = S N, N_i = R_i^T, is then
///
///     K_i = ( (less_i - dual_i) - [turn_i] ) R_i^T.
class Core {
 public:
  const GrowingGraph& graph() const { return graph_; }
  GrowingGraph& graph() { return graph_; }
  OnlineNode& node(Index i) { return nodes_[i]; }
  const OnlineNode& node(Index i) const { return nodes_[i]; }

  Index add_node(NodeId id) {
    nodes_.emplace_back();
    return graph_.add_node(id);
  }

  /// world_from_i.
  Quaternion rotation(Index i) const {
    const OnlineNode& node = nodes_[i];
    if (node.kind != NodeKind::hanging) return node.q;
    return Quaternion(product(nodes_[node.base].q, node.q)).normalized();
  }

  /// What an edge leaves over, at both ends; after a change of a rotation or of the edge.
  void update_edge(Index k) {
    OnlineEdge& e = graph_.edge(k);
    const Quaternion j_from_i(product(nodes_[e.j].q.conjugate(), nodes_[e.i].q));
    e.at_i = product(e.i_from_j, j_from_i);
    e.at_j = product(j_from_i, e.i_from_j);
    e.cost = cost(e.at_i);
  }
  /// The cost that an edge has at other rotations of its ends.
  double cost(Index k, const Quaternion& q_i, const Quaternion& q_j) const {
    const Quaternion j_from_i(product(q_j.conjugate(), q_i));
    return cost(product(graph_.edge(k).i_from_j, j_from_i));
  }
  /// r^2 of RobustLoss.
  double squared_chord(Index k, const Quaternion& q_i, const Quaternion& q_j) const {
    return cost(k, q_i, q_j) / (2.0 * graph_.edge(k).i_from_j.squaredNorm());
  }

  /// The sums over the edges at a node, after changes of these.
  void update_node(Index i) {
    OnlineNode& node = nodes_[i];
    node.degree = 0.0;
    node.num_edges = 0;
    node.less.setZero();
    node.turn.setZero();
    for (const GrowingGraph::End& end : graph_.ends(i)) {
      const OnlineEdge& e = graph_.edge(end.edge);
      if (!e.in_core || !(e.weight > 0.0)) continue;
      const bool is_i = e.i == i;
      const Vector4& residual = is_i ? e.at_i : e.at_j;
      const Vector3 v = vector_part(residual);
      const double s = is_i ? 2.0 * residual(3) : -2.0 * residual(3);
      node.degree += e.weight;
      ++node.num_edges;
      add(node.less, outer_product(-2.0 * v, v));
      add_to_diagonal(node.less, 2.0 * dot(v, v));
      for (int k = 0; k < 3; ++k) node.turn(k) += s * v(k);
    }
  }

  /// What is taken from the diagonal, of the degree, that rounding in K can be bounded by it.
  double relative_mu = 1e-9;

  // What CliqueTree asks for.
  double degree(Index i) const { return nodes_[i].degree; }
  double mu(Index i) const { return relative_mu * nodes_[i].degree; }
  /// The blocks Rt_ij are exact to 30 u w, their sums and the degree to as many u as there are.
  double block_rounding(Index i) const {
    return unit_roundoff * (4.0 * nodes_[i].num_edges + 100.0) * nodes_[i].degree;
  }
  Matrix3 diagonal(Index i) const {
    Matrix3 block;
    for (int k = 0; k < 9; ++k) block(k) = -nodes_[i].dual(k);
    add_to_diagonal(block, nodes_[i].degree);
    return block;
  }
  template <typename Function>
  void for_each_neighbour(Index i, Function&& f) const {
    for (const GrowingGraph::End& end : graph_.ends(i)) {
      const OnlineEdge& e = graph_.edge(end.edge);
      if (e.in_core && e.weight > 0.0 && nodes_[end.node].kind == NodeKind::core) f(end.node);
    }
  }
  template <typename Function>
  void for_each_entry(Index i, Function&& f) const {
    for (const GrowingGraph::End& end : graph_.ends(i)) {
      const OnlineEdge& e = graph_.edge(end.edge);
      if (!e.in_core || !(e.weight > 0.0) || nodes_[end.node].kind != NodeKind::core) continue;
      Matrix3 block = weighted_rotation(e.i == i ? e.i_from_j : e.i_from_j.conjugate());
      for (int k = 0; k < 9; ++k) block(k) = -block(k);
      f(end.node, block);
    }
  }
  Matrix3 right_hand_side(Index i, RightHandSide side) const {
    const OnlineNode& node = nodes_[i];
    Matrix3 K = hat(node.turn);
    for (int k = 0; k < 9; ++k) {
      K(k) = (side == for_bound ? node.less(k) - node.dual(k) : 0.0) - K(k);
    }
    return product_transposed(K, node.q.toRotationMatrix());
  }
  /// In at_i and at_j 64 u of the root of the weight (three products of quaternions, their lengths,
  /// that of the measurement), hence 400 u w in 2 s [v] and 2 (|v|^2 I - v v^T), 100 u w for R_i^T.
  double right_hand_side_rounding(Index i) const {
    return unit_roundoff * (4.0 * nodes_[i].num_edges + 500.0) * nodes_[i].degree;
  }
  /// R_i (less_i - dual_i) R_i^T.
  Matrix3 dual_is_off(Index i) const {
    const OnlineNode& node = nodes_[i];
    Matrix3 off;
    for (int k = 0; k < 9; ++k) off(k) = node.less(k) - node.dual(k);
    const Matrix3 R = node.q.toRotationMatrix();
    return product_transposed(product(R, off), R);
  }
  /// GradientNorm::relative.
  double relative_gradient(Index i) const {
    return 4.0 * std::sqrt(dot(nodes_[i].turn, nodes_[i].turn)) / nodes_[i].degree;
  }

 private:
  static double cost(const Vector4& residual) { return 8.0 * vector_square(residual); }

  GrowingGraph graph_;
  std::vector<OnlineNode> nodes_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

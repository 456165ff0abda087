#pragma once

#include <cmath>
#include <cstddef>
#include <unordered_map>
#include <vector>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// An edge of a graph that grows: R_i R_ij ~ R_j.
struct OnlineEdge {
  /// Of R_ij; its square is the weight in use, or any if that is 0.
  WeightedQuaternion i_from_j = WeightedQuaternion::Identity();
  Index i = -1;
  Index j = -1;
  double given = 0.0;    ///< the weight that was given
  double weight = 0.0;   ///< the one in use: the given one times what a robust loss leaves of it
  bool is_there = true;  ///< false once it is removed
  bool trusted = false;  ///< a robust loss does not touch it
  bool in_core = false;  ///< it lies on a cycle, or did; the others hang from these in trees
  double cost = 0.0;     ///< w |R_i R_ij - R_j|_F^2, of an edge of the core
  /// sqrt(w) times the quaternions of R_ij R_j^T R_i and R_j^T R_i R_ij.
  Vector4 at_i = Vector4::Zero(), at_j = Vector4::Zero();

  /// Whether a robust loss leaves it less than half its weight.
  bool is_left_out() const { return weight < 0.5 * given; }
  /// R_ij.
  Matrix3 rotation() const {
    Matrix3 R = weighted_rotation(i_from_j);
    R /= i_from_j.squaredNorm();
    return R;
  }
};

/// A measurement graph to which nodes and edges are added, and from which edges go. Nodes and edges
/// keep their numbers.
class GrowingGraph {
 public:
  /// Where an edge at a node leads.
  struct End {
    Index node;
    Index edge;
  };

  Index num_nodes() const { return static_cast<Index>(ids_.size()); }
  Index num_edges() const { return static_cast<Index>(edges_.size()); }
  const std::vector<NodeId>& ids() const { return ids_; }
  OnlineEdge& edge(Index k) { return edges_[k]; }
  const OnlineEdge& edge(Index k) const { return edges_[k]; }
  /// All edges at a node that have not been removed, those of weight 0, too.
  const std::vector<End>& ends(Index i) const { return ends_[i]; }

  /// -1 for an id that is not there.
  Index find(NodeId id) const {
    const auto found = row_of_.find(id);
    return found == row_of_.end() ? -1 : found->second;
  }

  Index add_node(NodeId id) {
    const Index row = num_nodes();
    row_of_.emplace(id, row);
    ids_.push_back(id);
    ends_.emplace_back();
    return row;
  }

  Index add_edge(const OnlineEdge& e) {
    const Index k = num_edges();
    edges_.push_back(e);
    ends_[e.i].push_back({e.j, k});
    ends_[e.j].push_back({e.i, k});
    return k;
  }

  void remove_edge(Index k) {
    OnlineEdge& e = edges_[k];
    e.is_there = false;
    e.weight = 0.0;
    for (const Index i : {e.i, e.j}) {
      std::vector<End>& ends = ends_[i];
      for (std::size_t p = 0; p < ends.size(); ++p) {
        if (ends[p].edge != k) continue;
        ends.erase(ends.begin() + static_cast<std::ptrdiff_t>(p));
        break;
      }
    }
  }

  /// A weight of 0 keeps the edge, unused.
  void set_weight(Index k, double weight) {
    OnlineEdge& e = edges_[k];
    e.weight = weight;
    if (weight > 0.0) e.i_from_j.coeffs() *= std::sqrt(weight) / e.i_from_j.norm();
  }

  /// Calls f(neighbour, edge number) for every edge in use at a node.
  template <typename Function>
  void for_each_used(Index i, Function&& f) const {
    for (const End& end : ends_[i]) {
      if (edges_[end.edge].weight > 0.0) f(end.node, end.edge);
    }
  }

 private:
  std::vector<NodeId> ids_;
  std::unordered_map<NodeId, Index> row_of_;
  std::vector<OnlineEdge> edges_;
  std::vector<std::vector<End>> ends_;
};

/// The nodes that are reached from one of two ends and not from the other, without one edge; empty
/// where there is another way between them. Both ends are searched from in turn, so it takes as
/// long as the smaller side.
inline std::vector<Index> smaller_side(const GrowingGraph& graph, Index i, Index j,
                                       Index without = -1) {
  std::vector<Index> side[2] = {{i}, {j}};
  std::size_t next[2] = {0, 0};
  std::unordered_map<Index, int> side_of{{i, 0}, {j, 1}};
  for (int s = 0;; s = 1 - s) {
    if (next[s] == side[s].size()) return side[s];
    bool meets = false;
    graph.for_each_used(side[s][next[s]++], [&](Index l, Index edge) {
      if (edge == without) return;
      const auto [found, is_new] = side_of.emplace(l, s);
      if (is_new) side[s].push_back(l);
      meets |= found->second != s;
    });
    if (meets) return {};
  }
}

}  // namespace rotavg

#pragma GCC diagnostic pop

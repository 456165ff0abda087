#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/graph/node_rows.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A measurement with its ends as rows of the graph: R_i R_ij ~ R_j.
struct Edge {
  Index i = 0;
  Index j = 0;
  Matrix3 i_from_j = Matrix3::Identity();
  double weight = 1.0;
};

/// An edge seen from one of its ends l, with the weight folded in: what the neighbour q says of l
/// is R_l ~ R_q R_ql.
struct HalfEdge {
  WeightedQuaternion node_from_l;  ///< of R_ql
  Index node;                      ///< q
  Index edge_and_end;

  Index edge() const { return edge_and_end / 2; }
  /// Whether l is the end i of the edge, so that R_ql is the transpose of the measured R_ij.
  bool is_i() const { return edge_and_end % 2 == 0; }
};

/// An edge as the inner loops read it: sqrt(w) times the quaternion of R_ij.
struct QuaternionEdge {
  WeightedQuaternion i_from_j;
  Index i;
  Index j;
};

/// The measurement graph: n nodes and m weighted relative rotations, held as a list of edges and,
/// in quaternions, as the block rows of the paper's symmetric matrix Rt (4). Parallel edges,
/// several components and nodes without edges are allowed. Immutable but for its weights.
class MeasurementGraph {
 public:
  /// The block row of one node.
  class Row {
   public:
    Row(const HalfEdge* begin, const HalfEdge* end) : begin_(begin), end_(end) {}
    const HalfEdge* begin() const { return begin_; }
    const HalfEdge* end() const { return end_; }
    Index size() const { return static_cast<Index>(end_ - begin_); }

   private:
    const HalfEdge* begin_;
    const HalfEdge* end_;
  };

  /// A graph of the nodes that the measurements name, in rising order of their ids.
  /// @throws InvalidEdge for a measurement that check_measurement refuses
  /// @throws std::invalid_argument if there are no measurements
  explicit MeasurementGraph(const std::vector<RelativeRotation>& measurements)
      : MeasurementGraph(measurements, ids_of(measurements)) {}

  /// A graph of the given nodes, whose order is that of every result.
  /// @throws InvalidEdge as above, and for an id that is not among the nodes
  /// @throws std::invalid_argument if a node stands twice or there are no measurements
  MeasurementGraph(const std::vector<RelativeRotation>& measurements, std::vector<NodeId> nodes)
      : nodes_(std::move(nodes)) {
    if (measurements.empty()) throw std::invalid_argument("the graph has no edges");
    constexpr std::size_t largest = std::numeric_limits<Index>::max() / 2;
    if (measurements.size() > largest || nodes_.size() > largest / 3) {
      throw std::invalid_argument("the graph is too large: found " + std::to_string(nodes_.size()) +
                                  " nodes and " + std::to_string(measurements.size()) + " edges");
    }
    const NodeRows rows(nodes_);
    edges_.reserve(measurements.size());
    for (const RelativeRotation& m : measurements) {
      const Index k = num_edges();
      const Matrix3 i_from_j = check_measurement(k, m);
      edges_.push_back({row_of(rows, m.i, k), row_of(rows, m.j, k), i_from_j, m.weight});
    }
    build_rows();
  }

  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  Index num_edges() const { return static_cast<Index>(edges_.size()); }
  const std::vector<NodeId>& nodes() const { return nodes_; }
  const std::vector<Edge>& edges() const { return edges_; }
  const std::vector<QuaternionEdge>& quaternion_edges() const { return quaternion_edges_; }

  /// The block Rt_lq = w R_lq of a half-edge of node l.
  static Matrix3 block(const HalfEdge& h) { return weighted_rotation(h.node_from_l.conjugate()); }

  /// The blocks of node l's row of Rt, in the order of the edges.
  Row row(Index l) const {
    return {half_edges_.data() + row_start_[l], half_edges_.data() + row_start_[l + 1]};
  }

  /// Gives the edges other weights (m,), in place: what depends on nodes and ends alone stays.
  /// @throws InvalidEdge for a weight out of bounds, and then changes nothing
  /// @throws std::invalid_argument unless there is one weight for each edge
  void set_weights(const std::vector<double>& weights) {
    if (weights.size() != edges_.size()) {
      throw std::invalid_argument("found " + std::to_string(weights.size()) +
                                  " weights; expected " + std::to_string(edges_.size()) +
                                  ", one for each edge");
    }
    for (Index k = 0; k < num_edges(); ++k) check_weight(k, weights[k]);
    for (Index k = 0; k < num_edges(); ++k) edges_[k].weight = weights[k];
    sum_weights();
    for (QuaternionEdge& e : quaternion_edges_) {
      const auto k = static_cast<std::size_t>(&e - quaternion_edges_.data());
      e.i_from_j.coeffs() *= std::sqrt(weights[k]) / e.i_from_j.norm();
    }
    for (HalfEdge& h : half_edges_) {
      const WeightedQuaternion& i_from_j = quaternion_edges_[h.edge()].i_from_j;
      h.node_from_l = i_from_j;
      if (h.is_i()) h.node_from_l = i_from_j.conjugate();
    }
  }

  /// deg_l, the sum of the weights of the edges at node l.
  double degree(Index l) const { return degree_[l]; }

  /// Sum of all weights.
  double total_weight() const { return total_weight_; }
  double min_weight() const { return min_weight_; }
  double max_weight() const { return max_weight_; }

 private:
  static std::vector<NodeId> ids_of(const std::vector<RelativeRotation>& measurements) {
    std::vector<NodeId> ids;
    ids.reserve(2 * measurements.size());
    for (const RelativeRotation& m : measurements) {
      ids.push_back(m.i);
      ids.push_back(m.j);
    }
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    return ids;
  }

  static Index row_of(const NodeRows& rows, NodeId id, Index edge) {
    const Index row = rows.find(id);
    if (row < 0) {
      throw InvalidEdge(edge, "node " + std::to_string(id) + " is not in the list of nodes");
    }
    return row;
  }

  void sum_weights() {
    degree_.assign(nodes_.size(), 0.0);
    total_weight_ = max_weight_ = 0.0;
    min_weight_ = std::numeric_limits<double>::infinity();
    for (const Edge& e : edges_) {
      degree_[e.i] += e.weight;
      degree_[e.j] += e.weight;
      total_weight_ += e.weight;
      min_weight_ = std::min(min_weight_, e.weight);
      max_weight_ = std::max(max_weight_, e.weight);
    }
  }

  void build_rows() {
    const std::size_t n = nodes_.size();
    sum_weights();
    row_start_.assign(n + 1, 0);
    for (const Edge& e : edges_) {
      ++row_start_[e.i + 1];
      ++row_start_[e.j + 1];
    }
    for (std::size_t k = 0; k < n; ++k) row_start_[k + 1] += row_start_[k];

    half_edges_.resize(2 * edges_.size());
    quaternion_edges_.reserve(edges_.size());
    std::vector<std::size_t> next(row_start_.begin(), row_start_.end() - 1);
    for (Index edge = 0; edge < num_edges(); ++edge) {
      const Edge& e = edges_[edge];
      WeightedQuaternion q(e.i_from_j);
      q.coeffs() *= std::sqrt(e.weight) / q.norm();
      quaternion_edges_.push_back({q, e.i, e.j});
      half_edges_[next[e.i]++] = {q.conjugate(), e.j, 2 * edge};
      half_edges_[next[e.j]++] = {q, e.i, 2 * edge + 1};
    }
  }

  std::vector<NodeId> nodes_;
  std::vector<Edge> edges_;
  std::vector<QuaternionEdge> quaternion_edges_;
  std::vector<std::size_t> row_start_;
  std::vector<HalfEdge> half_edges_;
  std::vector<double> degree_;
  double total_weight_ = 0.0, max_weight_ = 0.0;
  double min_weight_ = std::numeric_limits<double>::infinity();
};

/// (m,) the weights of the edges.
inline std::vector<double> weights_of(const MeasurementGraph& graph) {
  std::vector<double> weights;
  weights.reserve(graph.edges().size());
  for (const Edge& e : graph.edges()) weights.push_back(e.weight);
  return weights;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

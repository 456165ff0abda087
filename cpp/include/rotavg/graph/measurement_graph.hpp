#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/edges.hpp>
#include <rotavg/graph/measurement.hpp>
#include <rotavg/graph/node_rows.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The measurement graph: n nodes and m weighted relative rotations, held as quaternions in a list
/// of edges, with the list of every node's edges beside it: the block rows of the paper's symmetric
/// matrix Rt (4). An edge takes 64 bytes. Parallel edges, several components and nodes without
/// edges are allowed. Immutable but for its weights.
class MeasurementGraph {
 public:
  /// A graph of the nodes that the measurements name, in rising order of their ids.
  /// @throws InvalidEdge for a measurement that check_measurement refuses
  /// @throws std::invalid_argument if there are no measurements
  explicit MeasurementGraph(const std::vector<RelativeRotation>& measurements)
      : MeasurementGraph(measurements, ids_of(measurements)) {}

  /// A graph of the given nodes, whose order is that of every result.
  /// @throws InvalidEdge as above, and for an id that is not among the nodes
  /// @throws std::invalid_argument if a node stands twice or there are no measurements
  MeasurementGraph(const std::vector<RelativeRotation>& measurements, std::vector<NodeId> nodes)
      : MeasurementGraph(
            measurements.size(), [&](std::size_t k) { return measurements[k]; }, std::move(nodes)) {
  }

  /// The same of measurements that stand elsewhere.
  /// @param measurement `measurement(k)`, k from 0 to count - 1, is a RelativeRotation or a
  ///        RelativeQuaternion
  template <typename Measurement>
  MeasurementGraph(std::size_t count, Measurement&& measurement, std::vector<NodeId> nodes)
      : nodes_(std::move(nodes)) {
    if (count == 0) throw std::invalid_argument("the graph has no edges");
    constexpr std::size_t largest = std::numeric_limits<Index>::max() / 2;
    if (count > largest || nodes_.size() > largest / 3) {
      throw std::invalid_argument("the graph is too large: found " + std::to_string(nodes_.size()) +
                                  " nodes and " + std::to_string(count) + " edges");
    }
    const NodeRows rows(nodes_);
    edges_.reserve(count);
    weights_.reserve(count);
    for (std::size_t k = 0; k < count; ++k) {
      const auto m = measurement(k);
      const Index edge = num_edges();
      const WeightedQuaternion q = check_measurement(edge, m);
      edges_.push_back({q, row_of(rows, m.i, edge), row_of(rows, m.j, edge)});
      weights_.push_back(m.weight);
    }
    build_rows();
  }

  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  Index num_edges() const { return static_cast<Index>(edges_.size()); }
  const std::vector<NodeId>& nodes() const { return nodes_; }
  Edges edges() const { return {{edges_.data(), weights_.data()}, edges_.size()}; }
  /// The edges as the inner loops read them.
  const LargeVector<QuaternionEdge>& quaternion_edges() const { return edges_; }
  /// (m,) of the edges.
  const std::vector<double>& weights() const { return weights_; }

  /// The block Rt_lq = w R_lq of a half-edge of node l.
  static Matrix3 block(const HalfEdge& h) { return weighted_rotation(h.node_from_l.conjugate()); }

  /// The blocks of node l's row of Rt, in the order of the edges.
  HalfEdges row(Index l) const {
    return {{ends_.data() + row_start_[l], edges_.data()}, row_start_[l + 1] - row_start_[l]};
  }

  /// Memory that the graph takes.
  std::size_t bytes() const {
    const auto of = [](const auto& values) { return values.capacity() * sizeof(values[0]); };
    return of(nodes_) + of(edges_) + of(weights_) + of(row_start_) + of(ends_) + of(degree_);
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
    weights_ = weights;
    sum_weights();
    for (Index k = 0; k < num_edges(); ++k) {
      WeightedQuaternion& q = edges_[k].i_from_j;
      q.coeffs() *= std::sqrt(weights[k]) / q.norm();
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
    ids.shrink_to_fit();
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
    for (std::size_t k = 0; k < edges_.size(); ++k) {
      const double weight = weights_[k];
      degree_[edges_[k].i] += weight;
      degree_[edges_[k].j] += weight;
      total_weight_ += weight;
      min_weight_ = std::min(min_weight_, weight);
      max_weight_ = std::max(max_weight_, weight);
    }
  }

  void build_rows() {
    const std::size_t n = nodes_.size();
    sum_weights();
    row_start_.assign(n + 1, 0);
    for (const QuaternionEdge& e : edges_) {
      ++row_start_[e.i + 1];
      ++row_start_[e.j + 1];
    }
    for (std::size_t k = 0; k < n; ++k) row_start_[k + 1] += row_start_[k];

    ends_.resize(2 * edges_.size());
    std::vector<std::size_t> next(row_start_.begin(), row_start_.end() - 1);
    for (Index edge = 0; edge < num_edges(); ++edge) {
      const QuaternionEdge& e = edges_[edge];
      ends_[next[e.i]++] = {e.j, 2 * edge};
      ends_[next[e.j]++] = {e.i, 2 * edge + 1};
    }
  }

  std::vector<NodeId> nodes_;
  LargeVector<QuaternionEdge> edges_;
  std::vector<double> weights_;
  std::vector<std::size_t> row_start_;
  LargeVector<EdgeEnd> ends_;
  std::vector<double> degree_;
  double total_weight_ = 0.0, max_weight_ = 0.0;
  double min_weight_ = std::numeric_limits<double>::infinity();
};

}  // namespace rotavg

#pragma GCC diagnostic pop

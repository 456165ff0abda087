#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The part of a graph that its cycles check: all edges but the bridges, and the nodes that they
/// join. What bridges say can be met exactly, whatever the rest is, and so is no matter of it. (Of
/// a forest, which has no such part, all.)
class CheckedPart {
 public:
  /// @param graph must outlive this object
  /// @param left_out (m,) edges that close no cycles, but are no bridges either; empty for none
  CheckedPart(const MeasurementGraph& graph, std::vector<bool> left_out)
      : graph_(graph), series_(series_of(graph, left_out)), left_out_(std::move(left_out)) {
    std::vector<bool> joined(static_cast<std::size_t>(graph.num_nodes()), false);
    const bool forest = std::find_if(series_.label.begin(), series_.label.end(),
                                     [](Index s) { return s >= 0; }) == series_.label.end();
    for (Index k = 0; k < graph.num_edges(); ++k) {
      if (is_bridge(k) && !forest) continue;
      const Edge& e = graph.edges()[k];
      edges_.push_back(k);
      joined[e.i] = joined[e.j] = true;
    }
    std::vector<NodeId> ids;
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      if (!joined[i] && !forest) continue;
      nodes_.push_back(i);
      ids.push_back(graph.nodes()[i]);
    }
    if (is_all()) return;
    const auto measurement = [&](std::size_t k) -> RelativeQuaternion {
      const Edge e = graph.edges()[edges_[k]];
      return {graph.nodes()[e.i], graph.nodes()[e.j], e.quaternion, e.weight};
    };
    part_.emplace(edges_.size(), measurement, std::move(ids));
  }

  CheckedPart(const CheckedPart&) = delete;
  CheckedPart& operator=(const CheckedPart&) = delete;

  /// Of all edges.
  const Series& series() const { return series_; }
  /// Of those of the part.
  Series series_of_part() const {
    return {gather(series_.label, edges_), series_.size, series_.num_cycles};
  }
  bool is_bridge(Index k) const {
    return series_.label[k] < 0 && (left_out_.empty() || !left_out_[k]);
  }
  /// The part as a graph of its own.
  const MeasurementGraph& graph() const { return part_ ? *part_ : graph_; }

  /// Of what belongs to the edges or, of rotations, to the nodes of the whole graph, the part's.
  template <typename Value>
  std::vector<Value> of_edges(const std::vector<Value>& all) const {
    return all.empty() ? all : gather(all, edges_);
  }
  Rotations of_nodes(const Rotations& all) const { return gather(all, nodes_); }

  /// Rotations of the whole graph from those of the part: what hangs on a bridge is turned, as a
  /// whole, to where the bridge has it. Then no bridge leaves anything over, and the residuals of
  /// the part are as they were.
  Rotations extended(const Rotations& part) const {
    if (is_all()) return part;
    const BreadthFirstForest forest = breadth_first_forest(graph_, left_out_);
    Rotations R(forest.order.size(), Matrix3::Identity()), turn = R;
    for (std::size_t k = 0; k < nodes_.size(); ++k) R[nodes_[k]] = part[k];
    for (const Index node : forest.order) {
      const Index parent = forest.parent[node], edge = forest.tree_edge[node];
      if (parent < 0) continue;
      turn[node] = turn[parent];
      if (!is_bridge(edge)) continue;
      const Edge& e = graph_.edges()[edge];
      const Matrix3 parent_from_node = e.i == parent ? e.i_from_j() : e.i_from_j().transpose();
      turn[node] *= product_transposed(R[parent] * parent_from_node, R[node]);
    }
    for (std::size_t i = 0; i < R.size(); ++i) R[i] = turn[i] * R[i];
    return R;
  }

 private:
  bool is_all() const {
    return edges_.size() == graph_.edges().size() && nodes_.size() == graph_.nodes().size();
  }

  template <typename Values>
  static Values gather(const Values& all, const std::vector<Index>& rows) {
    Values some;
    some.reserve(rows.size());
    for (const Index row : rows) some.push_back(all[row]);
    return some;
  }

  const MeasurementGraph& graph_;
  Series series_;
  std::vector<bool> left_out_;
  std::vector<Index> edges_, nodes_;  ///< of the part, in the order of the graph
  std::optional<MeasurementGraph> part_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

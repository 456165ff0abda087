#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The part of a graph that its cycles check: all edges but the bridges and what is left out, and
/// the nodes that they join. What bridges say can be met exactly, whatever the rest is, and so is
/// no matter of it. (Of a forest, which has no such part, all.)
class CheckedPart {
 public:
  /// @param graph must outlive this object
  /// @param left_out (m,) edges that close no cycles, but are no bridges either; empty for none.
  ///        Where all are, nothing is.
  CheckedPart(const MeasurementGraph& graph, std::vector<bool> left_out)
      : graph_(graph), left_out_(std::move(left_out)) {
    const bool keeps_none = std::find(left_out_.begin(), left_out_.end(), false) == left_out_.end();
    if (keeps_none) left_out_.clear();
    series_ = series_of(graph, left_out_);
    std::vector<bool> joined(static_cast<std::size_t>(graph.num_nodes()), false);
    const bool forest = std::find_if(series_.label.begin(), series_.label.end(),
                                     [](Index s) { return s >= 0; }) == series_.label.end();
    for (Index k = 0; k < graph.num_edges(); ++k) {
      if ((is_bridge(k) && !forest) || is_left_out(k)) continue;
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
  bool is_bridge(Index k) const { return series_.label[k] < 0 && !is_left_out(k); }
  /// The part as a graph of its own.
  const MeasurementGraph& graph() const { return part_ ? *part_ : graph_; }

  /// Of what belongs to the edges or, of rotations, to the nodes of the whole graph, the part's.
  template <typename Value>
  std::vector<Value> of_edges(const std::vector<Value>& all) const {
    return all.empty() ? all : gather(all, edges_);
  }
  /// The other way round: edges of the whole graph (m,) that are in the part, and chosen there.
  std::vector<bool> of_whole(const std::vector<bool>& chosen) const {
    std::vector<bool> all(graph_.edges().size(), false);
    for (std::size_t p = 0; p < edges_.size(); ++p) all[edges_[p]] = chosen[p];
    return all;
  }
  Rotations of_nodes(const Rotations& all) const { return gather(all, nodes_); }

  /// Rotations of the whole graph from those of the part: what hangs on a bridge is turned, as a
  /// whole, to where the bridge has it. Then no bridge leaves anything over, and the residuals of
  /// the part are as they were. What only left-out edges join is turned to where these have it.
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
    if (!left_out_.empty()) turn_where_left_out(R);
    return R;
  }

 private:
  bool is_left_out(Index k) const { return !left_out_.empty() && left_out_[k]; }

  /// Of the parts into which the graph falls without the left-out edges, each is turned to where
  /// those have it that join it to the ones before, together: the nearest rotation to their sum.
  void turn_where_left_out(Rotations& R) const {
    std::vector<bool> kept(left_out_);
    kept.flip();
    const std::vector<Index> label = parts_joined_by(graph_, kept);
    const auto parts = static_cast<std::size_t>(1 + *std::max_element(label.begin(), label.end()));
    std::vector<std::vector<Index>> across(parts);  // edges
    for (Index k = 0; k < graph_.num_edges(); ++k) {
      const Edge& e = graph_.edges()[k];
      if (label[e.i] == label[e.j]) continue;
      across[label[e.i]].push_back(k);
      across[label[e.j]].push_back(k);
    }
    Rotations turn(parts, Matrix3::Identity());
    std::vector<bool> placed(parts, false);
    const auto place = [&](Index part) {
      Matrix3 sum = Matrix3::Zero();
      for (const Index k : across[part]) {
        const Edge& e = graph_.edges()[k];
        const Index here = label[e.i] == part ? e.i : e.j, there = here == e.i ? e.j : e.i;
        if (!placed[label[there]]) continue;
        const Matrix3 there_from_here = there == e.i ? e.i_from_j() : e.i_from_j().transpose();
        sum += e.weight * turn[label[there]] * R[there] * there_from_here * R[here].transpose();
      }
      turn[part] = nearest_rotation(sum);
      placed[part] = true;
    };
    for (std::size_t root = 0; root < parts; ++root) {
      if (placed[root]) continue;
      placed[root] = true;
      std::vector<Index> order{static_cast<Index>(root)};
      for (std::size_t at = 0; at < order.size(); ++at) {
        for (const Index k : across[order[at]]) {
          const Edge& e = graph_.edges()[k];
          const Index other = label[e.i] == order[at] ? label[e.j] : label[e.i];
          if (placed[other]) continue;
          place(other);
          order.push_back(other);
        }
      }
    }
    for (std::size_t i = 0; i < R.size(); ++i) R[i] = turn[label[i]] * R[i];
  }

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

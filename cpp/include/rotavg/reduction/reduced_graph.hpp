#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/riding.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The rows of the given measurements that join two variables.
inline std::vector<Index> edges_between_variables(const MeasurementGraph& given,
                                                  const Riding& riding) {
  std::vector<Index> kept;
  for (Index k = 0; k < given.num_edges(); ++k) {
    const Edge& e = given.edges()[k];
    if (riding.joins(e.i, e.j)) kept.push_back(k);
  }
  return kept;
}

/// The measurements between the variables that the nodes of a graph ride on, as a graph of these:
/// first those of the given measurements that join two variables, in their order, then others.
class ReducedGraph {
 public:
  /// @param given must outlive this object
  /// @param others edges between variables, known by their rows
  /// @throws std::invalid_argument if no edge joins two variables
  ReducedGraph(const MeasurementGraph& given, Riding riding,
               const std::vector<RelativeRotation>& others = {})
      : given_(&given),
        weights_(given.weights()),
        riding_(std::move(riding)),
        kept_(edges_between_variables(given, riding_)),
        graph_(reduced(others)) {}
  ReducedGraph(const MeasurementGraph&&, Riding,
               const std::vector<RelativeRotation>& = {}) = delete;

  const MeasurementGraph& given() const { return *given_; }
  /// (m,) of the given measurements.
  const std::vector<double>& weights() const { return weights_; }
  const Riding& riding() const { return riding_; }
  const MeasurementGraph& graph() const { return graph_; }
  /// The rows of the given measurements that are edges 0 … size - 1 of graph().
  const std::vector<Index>& kept() const { return kept_; }

  /// Gives the measurements other weights, one for each of the given graph.
  /// @throws InvalidEdge for a weight out of bounds, and then changes nothing
  /// @throws std::invalid_argument unless they are as many
  void set_weights(std::vector<double> weights) {
    check_count(weights.size(), weights_.size());
    for (std::size_t k = 0; k < weights.size(); ++k) {
      check_weight(static_cast<Index>(k), weights[k]);
    }
    weights_ = std::move(weights);
    std::vector<double> reduced;
    reduced.reserve(graph_.edges().size());
    for (const Index k : kept_) reduced.push_back(weights_[k]);
    for (std::size_t k = kept_.size(); k < graph_.edges().size(); ++k) {
      reduced.push_back(graph_.edges()[k].weight);
    }
    graph_.set_weights(reduced);
  }
  /// Gives the other edges other weights, in their order.
  /// @throws InvalidEdge for a weight out of bounds, and then changes nothing
  /// @throws std::invalid_argument unless they are as many
  void set_other_weights(const std::vector<double>& weights) {
    std::vector<double> reduced = graph_.weights();
    check_count(weights.size(), reduced.size() - kept_.size());
    std::copy(weights.begin(), weights.end(),
              reduced.begin() + static_cast<std::ptrdiff_t>(kept_.size()));
    graph_.set_weights(reduced);
  }

 private:
  static void check_count(std::size_t found, std::size_t expected) {
    if (found == expected) return;
    throw std::invalid_argument("found " + std::to_string(found) + " weights; expected " +
                                std::to_string(expected) + ", one for each edge");
  }

  /// Edge i j as one between variables, C_i R_ij C_j^T; where both are nodes alone, bit by bit
  /// R_ij.
  MeasurementGraph reduced(const std::vector<RelativeRotation>& others) const {
    const Quaternions C = to_quaternions(riding_.variable_from_node);
    const auto measurement = [&](std::size_t k) -> RelativeQuaternion {
      if (k >= kept_.size()) {
        const RelativeRotation& m = others[k - kept_.size()];
        return {m.i, m.j, WeightedQuaternion(m.i_from_j), m.weight};
      }
      const Edge& e = given_->edges()[kept_[k]];
      const WeightedQuaternion rotated(product(C[e.i], e.quaternion));
      return {riding_.variable[e.i], riding_.variable[e.j],
              WeightedQuaternion(product(rotated, WeightedQuaternion(conjugated(C[e.j])))),
              e.weight};
    };
    return MeasurementGraph(kept_.size() + others.size(), measurement, rows(riding_.num_variables));
  }

  static std::vector<NodeId> rows(Index num_variables) {
    std::vector<NodeId> ids(static_cast<std::size_t>(num_variables));
    std::iota(ids.begin(), ids.end(), NodeId{0});
    return ids;
  }

  const MeasurementGraph* given_;
  std::vector<double> weights_;
  Riding riding_;
  std::vector<Index> kept_;
  MeasurementGraph graph_;
};

/// The components of nodes from those of the variables they ride on, with the same labels.
inline Components components_of_nodes(const Riding& riding, const Components& of_variables) {
  Components components;
  components.nodes.resize(of_variables.nodes.size());
  for (Index i = 0; i < riding.num_nodes(); ++i) {
    const Index label = of_variables.label[riding.variable[i]];
    std::vector<Index>& nodes = components.nodes[label];
    components.label.push_back(label);
    components.row_in_component.push_back(static_cast<Index>(nodes.size()));
    nodes.push_back(i);
  }
  return components;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/reduction/checked_priors.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/reduction/reduced_graph.hpp>
#include <rotavg/reduction/rigs.hpp>
#include <rotavg/reduction/world.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Measurements and what is known beforehand as one graph of free variables and ordinary edges,
/// whose first node is the world, held at I: all that solves, certifies and measures graphs does so
/// for this one. (Where nothing holds the world, there are rigs alone, and it is left out.)
class GroundedGraph {
 public:
  /// @param given must outlive this object
  /// @throws InvalidPrior as checked_priors(), and where fixed rotations do not fit a rig
  /// @throws std::invalid_argument if nothing is left to solve, or nothing says anything of it
  GroundedGraph(const MeasurementGraph& given, const Priors& priors)
      : priors_(checked_priors(given, priors)),
        has_world_(priors.hold_world()),
        frames_(ride_on_frames(given.num_nodes(), priors_.rigs)),
        reduced_(reduce(given)),
        components_(connected_components(reduced_.graph())),
        free_heading_(find_free_headings()) {
    if (num_free_headings() > 0) gravity_.free_heading = free_heading_;
  }
  GroundedGraph(const MeasurementGraph&&, const Priors&) = delete;

  const MeasurementGraph& given() const { return reduced_.given(); }
  const CheckedPriors& priors() const { return priors_; }
  /// Whether the first node of graph() is the world.
  bool has_world() const { return has_world_; }
  /// What the nodes ride on without the world: their frames.
  const Riding& frames() const { return frames_; }
  const Riding& riding() const { return reduced_.riding(); }
  /// First the measurements kept(), then absolute priors, then gravity.
  const MeasurementGraph& graph() const { return reduced_.graph(); }
  /// The rows of the given measurements that are the first edges of graph(); all others are between
  /// nodes of one variable.
  const std::vector<Index>& kept() const { return reduced_.kept(); }
  const GravityPairs& gravity() const { return gravity_; }
  /// Of the variables; 0 is that of the world.
  const Components& components() const { return components_; }

  /// Gives the measurements other weights, one for each of the given graph.
  /// @throws InvalidEdge, std::invalid_argument as ReducedGraph::set_weights()
  void set_weights(std::vector<double> weights) { reduced_.set_weights(std::move(weights)); }
  const std::vector<double>& weights() const { return reduced_.weights(); }

  /// Gives absolute priors and gravity other weights, in the order of priors().
  /// @throws InvalidPrior for a weight out of bounds, and then changes nothing
  /// @throws std::invalid_argument unless there is one weight for each prior
  void set_prior_weights(const std::vector<double>& absolute, const std::vector<double>& gravity) {
    if (absolute.size() != priors_.absolute.size() || gravity.size() != priors_.gravity.size()) {
      throw std::invalid_argument("expected one weight for each prior");
    }
    CheckedPriors weighted = priors_;
    std::vector<double> of_edges;
    for (std::size_t k = 0; k < absolute.size(); ++k) {
      CheckedPriors::Rotation& p = weighted.absolute[k];
      p.weight = checked_weight(PriorKind::absolute, p.node, absolute[k]);
      if (riding().variable[p.node] != 0) of_edges.push_back(p.weight);
    }
    for (std::size_t k = 0; k < gravity.size(); ++k) {
      CheckedPriors::Gravity& p = weighted.gravity[k];
      p.weight = checked_weight(PriorKind::gravity, p.node, gravity[k]);
      if (riding().variable[p.node] != 0) of_edges.insert(of_edges.end(), 2, p.weight);
    }
    reduced_.set_other_weights(of_edges);
    priors_ = std::move(weighted);
  }

  /// Labels (variables,) of the parts that gravity alone holds, so that their heading is free;
  /// others have -1.
  /// @param holds (m',) the edges of graph() that count; empty: all
  std::vector<Index> find_free_headings(const std::vector<bool>& holds = {}) const {
    const auto& edges = graph().edges();
    std::vector<Index> label(graph().nodes().size(), -1);
    if (gravity_.first.empty()) return label;
    const auto counts = [&](Index k) { return holds.empty() || holds[k]; };
    std::vector<bool> inside;  // between two variables that are not the world
    for (Index k = 0; k < graph().num_edges(); ++k) {
      inside.push_back(edges[k].i != 0 && edges[k].j != 0 && counts(k));
    }
    const std::vector<Index> part = parts_joined_by(graph(), inside);
    std::vector<bool> held(part.size(), false), tilted(part.size(), false);
    held[part[0]] = true;
    const Index first_gravity = gravity_.first.front();
    for (Index k = 0; k < graph().num_edges(); ++k) {
      if ((edges[k].i != 0 && edges[k].j != 0) || !counts(k)) continue;
      const Index variable = edges[k].i == 0 ? edges[k].j : edges[k].i;
      (k < first_gravity ? held : tilted)[part[variable]] = true;
    }
    std::vector<Index> label_of_part(part.size(), -1);
    Index labels = 0;
    for (std::size_t p = 0; p < part.size(); ++p) {
      if (tilted[p] && !held[p]) label_of_part[p] = labels++;
    }
    for (std::size_t v = 0; v < label.size(); ++v) label[v] = label_of_part[part[v]];
    return label;
  }
  /// The same where all edges count.
  const std::vector<Index>& free_heading() const { return free_heading_; }
  Index num_free_headings() const {
    Index count = 0;
    for (const Index label : free_heading_) count = std::max(count, label + 1);
    return count;
  }

  /// Which edges (m',) of graph() hold where only some of the measurements (m,), absolute priors
  /// and gravity do, in the order of priors().
  std::vector<bool> edges_where(const std::vector<bool>& measurements,
                                const std::vector<bool>& absolute,
                                const std::vector<bool>& gravity) const {
    std::vector<bool> holds;
    for (const Index k : kept()) holds.push_back(measurements[k]);
    for (std::size_t k = 0; k < priors_.absolute.size(); ++k) {
      if (riding().variable[priors_.absolute[k].node] != 0) holds.push_back(absolute[k]);
    }
    for (std::size_t k = 0; k < priors_.gravity.size(); ++k) {
      if (riding().variable[priors_.gravity[k].node] != 0) holds.insert(holds.end(), 2, gravity[k]);
    }
    return holds;
  }

  /// Labels (n,) of the parts of the given nodes that the world, frames and some edges (m',) of
  /// graph() hold together, numbered in the order of their first nodes.
  std::vector<Index> parts_of_nodes(const std::vector<bool>& holds) const {
    const std::vector<Index> part = parts_joined_by(graph(), holds);
    std::vector<Index> number(part.size(), -1), label;
    Index parts = 0;
    for (const Index v : riding().variable) {
      if (number[part[v]] < 0) number[part[v]] = parts++;
      label.push_back(number[part[v]]);
    }
    return label;
  }

  /// Rotations of the given nodes from those of the variables. What is fixed is as it was given; of
  /// several fixed cameras of one frame, the first.
  Rotations nodes_from(const Rotations& Q) const {
    Rotations R = riding().nodes_from(Q);
    std::vector<bool> held(static_cast<std::size_t>(frames_.num_variables), false);
    for (const CheckedPriors::Rotation& p : priors_.fixed) {
      const Index frame = frames_.variable[p.node];
      if (!held[frame]) R[p.node] = p.world_from_node;
      held[frame] = true;
    }
    return R;
  }
  /// Rotations of the variables from those of the given nodes; I of the world.
  Rotations variables_from(const Rotations& R) const {
    Rotations Q = riding().variables_from(R);
    if (has_world_) Q[0].setIdentity();
    return Q;
  }

 private:
  double checked_weight(PriorKind kind, Index row, double weight) const {
    return detail::PriorCheck::weight(kind, given().nodes()[row], weight);
  }

  ReducedGraph reduce(const MeasurementGraph& given) {
    if (!has_world_) {
      if (edges_between_variables(given, frames_).empty()) {
        throw std::invalid_argument(
            "all edges are between cameras of one frame: none says how two frames lie to one "
            "another (for the sensors alone, average the graph whose nodes they are)");
      }
      return ReducedGraph(given, frames_);
    }
    Riding riding = riding_on(ride_on_world(frames_, priors_.fixed, given), frames_);
    if (riding.num_variables == 1) {
      throw std::invalid_argument("the rotations of all nodes are fixed: nothing is left to solve");
    }
    const auto kept = static_cast<Index>(edges_between_variables(given, riding).size());
    const std::vector<RelativeRotation> priors = edges_of_world(priors_, riding, kept, gravity_);
    if (kept == 0 && priors.empty()) {
      throw std::invalid_argument("no edge and no prior says anything of a node that is not fixed");
    }
    return ReducedGraph(given, std::move(riding), priors);
  }

  CheckedPriors priors_;
  bool has_world_;
  Riding frames_;
  GravityPairs gravity_;  // made before reduced_, as what makes that fills it
  ReducedGraph reduced_;
  Components components_;
  std::vector<Index> free_heading_;
};

/// The components of the given nodes without the world, where rigs join nodes as edges do.
inline Components components_without_world(const GroundedGraph& problem) {
  const MeasurementGraph& given = problem.given();
  const Riding& frames = problem.frames();
  if (problem.priors().rigs.empty()) return connected_components(given);
  if (!edges_between_variables(given, frames).empty()) {
    return components_of_nodes(frames, connected_components(ReducedGraph(given, frames).graph()));
  }
  Components alone;  // every frame is one
  alone.nodes.resize(static_cast<std::size_t>(frames.num_variables));
  for (Index v = 0; v < frames.num_variables; ++v) {
    alone.label.push_back(v);
    alone.row_in_component.push_back(0);
    alone.nodes[static_cast<std::size_t>(v)].push_back(v);
  }
  return components_of_nodes(frames, alone);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

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
  void set_weights(std::vector<double> weights) { reduced_.set_weights(std::move(weights)); }
  const std::vector<double>& weights() const { return reduced_.weights(); }

  /// Gives absolute priors and gravity other weights, in the order of priors().
  /// @throws InvalidEdge for a weight out of bounds
  void set_prior_weights(const std::vector<double>& absolute, const std::vector<double>& gravity) {
    std::vector<double> of_edges;
    for (std::size_t k = 0; k < absolute.size(); ++k) {
      priors_.absolute[k].weight = absolute[k];
      if (riding().variable[priors_.absolute[k].node] != 0) of_edges.push_back(absolute[k]);
    }
    for (std::size_t k = 0; k < gravity.size(); ++k) {
      priors_.gravity[k].weight = gravity[k];
      if (riding().variable[priors_.gravity[k].node] == 0) continue;
      of_edges.insert(of_edges.end(), 2, gravity[k]);
    }
    reduced_.set_other_weights(of_edges);
  }

  /// Labels (variables,) of the parts that gravity alone holds, so that their heading is free;
  /// others have -1.
  const std::vector<Index>& free_heading() const { return free_heading_; }
  Index num_free_headings() const {
    Index count = 0;
    for (const Index label : free_heading_) count = std::max(count, label + 1);
    return count;
  }

  /// Rotations of the given nodes from those of the variables. What is fixed is as it was given.
  Rotations nodes_from(const Rotations& Q) const {
    Rotations R = riding().nodes_from(Q);
    for (const CheckedPriors::Rotation& p : priors_.fixed) R[p.node] = p.world_from_node;
    return R;
  }
  /// Rotations of the variables from those of the given nodes; I of the world.
  Rotations variables_from(const Rotations& R) const {
    Rotations Q = riding().variables_from(R);
    if (has_world_) Q[0].setIdentity();
    return Q;
  }

 private:
  ReducedGraph reduce(const MeasurementGraph& given) {
    if (!has_world_) return ReducedGraph(given, frames_);
    Riding riding = riding_on(ride_on_world(frames_, priors_.fixed, given), frames_);
    if (riding.num_variables == 1) {
      throw std::invalid_argument("the rotations of all nodes are fixed: nothing is left to solve");
    }
    Index kept = 0;
    for (const Edge& e : given.edges()) kept += riding.variable[e.i] != riding.variable[e.j];
    const std::vector<RelativeRotation> priors = edges_of_world(priors_, riding, kept, gravity_);
    if (kept == 0 && priors.empty()) {
      throw std::invalid_argument("no edge and no prior says anything of a node that is not fixed");
    }
    return ReducedGraph(given, std::move(riding), priors);
  }

  std::vector<Index> find_free_headings() const {
    const auto& edges = graph().edges();
    std::vector<Index> label(graph().nodes().size(), -1);
    if (gravity_.first.empty()) return label;
    std::vector<bool> inside;  // between two variables that are not the world
    for (const Edge& e : edges) inside.push_back(e.i != 0 && e.j != 0);
    const std::vector<Index> part = parts_joined_by(graph(), inside);
    std::vector<bool> held(part.size(), false), tilted(part.size(), false);
    held[part[0]] = true;
    const Index first_gravity = gravity_.first.front();
    for (Index k = 0; k < graph().num_edges(); ++k) {
      if (inside[k]) continue;
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

  CheckedPriors priors_;
  bool has_world_;
  Riding frames_;
  GravityPairs gravity_;
  ReducedGraph reduced_;
  Components components_;
  std::vector<Index> free_heading_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

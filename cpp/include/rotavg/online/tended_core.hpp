#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/online/clique_tree.hpp>
#include <rotavg/online/component.hpp>
#include <rotavg/online/component_sums.hpp>
#include <rotavg/online/core.hpp>
#include <rotavg/online/hanging.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The structure of a graph that grows: components, their grounds, what hangs and what is core. It
/// keeps the sums of the core and the cliques' tree told of what changes, and takes note of the
/// nodes whose rows of S changed, which have to be eliminated anew.
class TendedCore {
 public:
  Core core;
  CliqueTree<Core> tree{core};
  std::vector<OnlineComponent> components;
  std::vector<Index> touched;  ///< nodes of the core
  /// Whether S has lost anything since the factor was made: an edge has gone or is lighter, or of
  /// two grounds one is left. The factor then bounds no cost.
  bool has_loosened = false;
  std::vector<Index> fresh;   ///< edges that have come to the core
  std::vector<Index> parted;  ///< nodes that are in another component than before
  Index num_components = 0;

  const GrowingGraph& graph() const { return core.graph(); }
  OnlineComponent& component_of(Index node) { return components[core.node(node).component]; }

  Index add_node(NodeId id) {
    const Index i = core.add_node(id);
    tree.resize(i + 1);
    marked_.push_back(false);
    start_component({i}, i);
    return i;
  }

  /// An edge that is to be used, at the weight that it has now.
  void use(Index k) {
    const OnlineEdge& e = graph().edge(k);
    const double weight = e.weight;
    if (core.node(e.i).component != core.node(e.j).component) {
      join(k);
    } else {
      enter_core(e.i);
      enter_core(e.j);
      set_in_core(k);
    }
    OnlineComponent& component = component_of(e.i);
    change_weight(component, 0.0, weight);
    ++component.num_edges;
    component.is_touched = true;
  }

  /// An edge is no longer used.
  void drop(Index k, bool for_good) {
    const double weight = graph().edge(k).weight;
    const Index i = graph().edge(k).i, j = graph().edge(k).j;
    const bool was_in_core = graph().edge(k).in_core;
    OnlineComponent& component = component_of(i);
    change_weight(component, weight, 0.0);
    --component.num_edges;
    component.is_touched = true;
    lower_weight(component, weight);
    if (was_in_core) {
      change_objective(component, graph().edge(k).cost, 0.0);
      core.graph().edge(k).cost = 0.0;
    }
    core.graph().edge(k).in_core = false;
    for_good ? core.graph().remove_edge(k) : core.graph().set_weight(k, 0.0);
    if (was_in_core) {
      has_loosened = true;
      touch(i);
      touch(j);
      split(i, j);
    } else {
      cut(core.node(i).anchor_edge == k ? i : j);
    }
  }

  /// Whether an edge of the core is the only way between its ends.
  bool is_bridge(Index k) const {
    return !smaller_side(graph(), graph().edge(k).i, graph().edge(k).j, k).empty();
  }

  void set_weight(Index k, double weight) {
    OnlineComponent& component = component_of(graph().edge(k).i);
    const double old = graph().edge(k).weight;
    component.is_touched = true;
    if (weight < old) lower_weight(component, old - weight);
    core.graph().set_weight(k, weight);
    change_weight(component, old, weight);
    if (!graph().edge(k).in_core) return;
    has_loosened |= weight < old;
    update_edge(k);
    touch(graph().edge(k).i);
    touch(graph().edge(k).j);
  }

  /// After changes of the rotations of its ends, or of its weight.
  void update_edge(Index k) {
    const double old = graph().edge(k).cost;
    core.update_edge(k);
    change_objective(component_of(graph().edge(k).i), old, graph().edge(k).cost);
  }

  void update_node(Index i) {
    core.update_node(i);
    tree.mark_variable(i);
  }

  /// Its rows of S have changed.
  void touch(Index i) {
    if (!marked_[i]) touched.push_back(i);
    marked_[i] = true;
  }
  void clear_touched() {
    for (const Index i : touched) marked_[i] = false;
    touched.clear();
    has_loosened = false;
  }

 private:
  Index start_component(std::vector<Index> nodes, Index ground) {
    if (free_.empty()) {
      free_.push_back(static_cast<Index>(components.size()));
      components.emplace_back();
    }
    const Index c = free_.back();
    free_.pop_back();
    for (const Index i : nodes) core.node(i).component = c;
    OnlineComponent component;
    component.ground = ground;
    component.nodes = std::move(nodes);
    components[c] = std::move(component);
    ++num_components;
    return c;
  }

  void end_component(Index c) {
    components[c] = OnlineComponent();
    free_.push_back(c);
    --num_components;
  }

  void set_in_core(Index k) {
    OnlineEdge& e = core.graph().edge(k);
    if (e.in_core) return;
    e.in_core = true;
    e.cost = 0.0;
    update_edge(k);
    fresh.push_back(k);
    touch(e.i);
    touch(e.j);
  }

  /// A node, and those between it and the core, become core.
  void enter_core(Index i) {
    std::vector<Index> path;
    for (; core.node(i).kind == NodeKind::hanging; i = core.node(i).anchor) path.push_back(i);
    while (!path.empty()) {
      const Index p = path.back();
      path.pop_back();
      OnlineNode& node = core.node(p);
      node.q = core.rotation(p);
      node.kind = NodeKind::core;
      const Index edge = std::exchange(node.anchor_edge, -1);
      node.anchor = node.base = -1;
      hang_anew(core, p);
      set_in_core(edge);
    }
  }

  /// Two components become one: the larger keeps its ground, and the other is turned to meet the
  /// edge.
  void join(Index k) {
    Index i = graph().edge(k).i, j = graph().edge(k).j;
    if (component_of(i).nodes.size() < component_of(j).nodes.size()) std::swap(i, j);
    const Index c = core.node(i).component, other = core.node(j).component;
    const Index ground = components[other].ground;
    const OnlineNode& at_i = core.node(i);
    const bool rides = at_i.kind == NodeKind::hanging;
    const Quaternion j_estimate = ride(graph(), k, i, rides ? at_i.q : Quaternion::Identity());
    if (components[other].nodes.size() == 1) {
      OnlineNode& node = core.node(j);
      node.kind = NodeKind::hanging;
      node.q = j_estimate;
      node.base = rides ? at_i.base : i;
      node.anchor = i;
      node.anchor_edge = k;
    } else {
      const Quaternion target = ride(graph(), k, i, core.rotation(i));
      const Quaternion turn(product(target, core.rotation(j).conjugate()));
      for (const Index l : components[other].nodes) {
        OnlineNode& node = core.node(l);
        if (node.kind == NodeKind::hanging) continue;
        node.q = Quaternion(product(turn, node.q)).normalized();
        tree.mark_variable(l);
      }
      enter_core(i);
      enter_core(j);
      core.node(ground).kind = NodeKind::core;
      has_loosened = true;
      touch(ground);
      core.for_each_neighbour(ground, [&](Index l) { touch(l); });
      set_in_core(k);
    }
    OnlineComponent& component = components[c];
    for (const Index l : components[other].nodes) {
      core.node(l).component = c;
      component.nodes.push_back(l);
      parted.push_back(l);
    }
    add_sums(component, components[other]);
    end_component(other);
  }

  /// A hanging node has lost its anchor.
  void cut(Index j) {
    const std::vector<Index> side = hanging_tree(core, j);
    const Quaternion q = core.rotation(j);
    OnlineNode& node = core.node(j);
    node.kind = NodeKind::ground;
    node.q = q;
    node.base = node.anchor = node.anchor_edge = -1;
    separate(side, j);
    hang_anew(core, j);
  }

  /// After an edge of the core between i and j has gone.
  void split(Index i, Index j) {
    std::vector<Index> side = smaller_side(graph(), i, j);
    if (side.empty()) return;
    const Index c = core.node(i).component;
    const Index ground = components[c].ground;
    std::vector<char> in_side(static_cast<std::size_t>(graph().num_nodes()), 0);
    for (const Index l : side) in_side[l] = 1;
    if (in_side[ground]) {
      std::vector<Index> rest;
      for (const Index l : components[c].nodes) {
        if (!in_side[l]) rest.push_back(l);
      }
      side = std::move(rest);
    }
    std::sort(side.begin(), side.end());
    Index new_ground = -1;
    std::vector<Index> in_core;
    for (const Index l : side) {
      if (core.node(l).kind == NodeKind::core) in_core.push_back(l);
    }
    new_ground = in_core.front();
    tree.resize(graph().num_nodes());
    tree.detach(in_core);
    tree.forget(new_ground);
    for (const Index l : in_core) touch(l);
    core.node(new_ground).kind = NodeKind::ground;
    separate(side, new_ground);
  }

  /// Takes nodes out of their component, as one of their own.
  void separate(const std::vector<Index>& side, Index ground) {
    const Index c = core.node(ground).component;
    std::vector<char> in_side(static_cast<std::size_t>(graph().num_nodes()), 0);
    for (const Index l : side) in_side[l] = 1;
    std::vector<Index> rest;
    for (const Index l : components[c].nodes) {
      if (!in_side[l]) rest.push_back(l);
    }
    components[c].nodes = std::move(rest);
    const Index other = start_component(side, ground);
    parted.insert(parted.end(), side.begin(), side.end());
    for (const Index part : {c, other}) {
      components[part].is_touched = true;
      sum_anew(components[part], graph());
    }
  }

  std::vector<Index> free_;  // components that are no more
  std::vector<bool> marked_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <limits>

#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/online/component.hpp>
#include <rotavg/online/growing_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

// What is summed over the edges of a component, and kept up as they change: objective, with what
// rounding can have made of it, weight, and the lower bound.

/// An edge of the core costs something else.
inline void change_objective(OnlineComponent& component, double old, double now) {
  component.objective = std::max(component.objective + (now - old), 0.0);
  component.drift += 4.0 * unit_roundoff * (component.objective + old + now);
}

/// Some weight is gone: no edge costs more than 8 times its weight, as |R - R'|_F^2 <= 8.
inline void lower_weight(OnlineComponent& component, double by) {
  component.lower_bound = std::max(component.lower_bound - 8.0 * by, 0.0);
}

/// The lightest edge, and what all count for beside it (counted_weight).
inline void count_weights(OnlineComponent& component, const GrowingGraph& graph) {
  const auto for_each_weight = [&](auto&& f) {
    for (const Index l : component.nodes) {
      for (const GrowingGraph::End& end : graph.ends(l)) {
        const OnlineEdge& e = graph.edge(end.edge);
        if (e.i == l && e.weight > 0.0) f(e.weight);
      }
    }
  };
  component.lightest = std::numeric_limits<double>::infinity();
  for_each_weight([&](double w) { component.lightest = std::min(component.lightest, w); });
  component.counted = 0.0;
  component.is_counted = true;
  for_each_weight(
      [&](double w) { component.counted += detail::counted_weight(w, component.lightest); });
}

/// An edge has another weight; zero where it is not used.
inline void change_weight(OnlineComponent& component, double old, double now) {
  constexpr double much = 0.5;  // lighter, or all would be counted again and again
  component.weight = std::max(component.weight + (now - old), 0.0);
  if (now > 0.0 && now < much * component.lightest) component.is_counted = false;
  if (!component.is_counted) return;
  const double change = detail::counted_weight(now, component.lightest) -
                        detail::counted_weight(old, component.lightest);
  component.counted = std::max(component.counted + change, 0.0);
}

/// The sums of another component, but for its nodes, are added.
inline void add_sums(OnlineComponent& component, const OnlineComponent& other) {
  component.objective += other.objective;
  component.drift += other.drift + 2.0 * unit_roundoff * component.objective;
  component.weight += other.weight;
  if (other.num_edges > 0) component.is_counted = false;
  component.num_edges += other.num_edges;
  component.lower_bound += other.lower_bound;
  component.lower_bound -= 2.0 * unit_roundoff * component.lower_bound;
}

/// The objective anew, by Kahan's summation: its error does not grow with the number of edges.
inline void sum_objective(OnlineComponent& component, const GrowingGraph& graph) {
  double sum = 0.0, excess = 0.0;
  for (const Index i : component.nodes) {
    for (const GrowingGraph::End& end : graph.ends(i)) {
      const OnlineEdge& e = graph.edge(end.edge);
      if (e.i != i || !e.in_core || !(e.weight > 0.0)) continue;
      const double term = e.cost - excess, next = sum + term;
      excess = (next - sum) - term;
      sum = next;
    }
  }
  component.objective = sum;
  component.drift = 4.0 * unit_roundoff * sum;
}

/// All sums anew, of a component that was part of another: of either alone nothing is proved.
inline void sum_anew(OnlineComponent& component, const GrowingGraph& graph) {
  component.lower_bound = 0.0;
  component.weight = 0.0;
  component.num_edges = 0;
  for (const Index l : component.nodes) {
    for (const GrowingGraph::End& end : graph.ends(l)) {
      const OnlineEdge& e = graph.edge(end.edge);
      if (e.i != l || !(e.weight > 0.0)) continue;
      component.weight += e.weight;
      ++component.num_edges;
    }
  }
  count_weights(component, graph);
  sum_objective(component, graph);
}

}  // namespace rotavg

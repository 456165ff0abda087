#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/robust/alternative.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A step between two answers that noise does not make: a chord, radians.
inline double step_tolerance(double noise) {
  constexpr double least = 0.05, noises = 6.0;
  return std::max(least, noises * noise);
}

/// The groups (n,) of cameras that two answers place alike: what the relative rotation of an
/// answer to the other, R_i S_i^T, holds together over the edges, and what agrees with the largest
/// of these in every component, whose label is 0. A bend along a street is no difference, a step
/// is.
///
/// @param tolerance a chord
inline std::vector<Index> shared_groups(const MeasurementGraph& graph, const Rotations& R,
                                        const Rotations& S, double tolerance) {
  const double most = tolerance * tolerance;
  Rotations turn(R.size());
  for (std::size_t i = 0; i < R.size(); ++i) turn[i] = R[i] * S[i].transpose();
  std::vector<bool> holds(graph.edges().size());
  for (std::size_t k = 0; k < holds.size(); ++k) {
    const Edge& e = graph.edges()[k];
    holds[k] = squared_chord(turn[e.i], turn[e.j]) <= most;
  }
  std::vector<Index> group = parts_joined_by(graph, holds);
  const Components components = connected_components(graph);
  const Index size = 1 + *std::max_element(group.begin(), group.end());
  std::vector<Index> count(size, 0), order(size), rank(size, -1), first(size);
  for (const Index g : group) ++count[g];
  for (std::size_t i = group.size(); i-- > 0;) first[group[i]] = static_cast<Index>(i);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](Index a, Index b) { return count[a] > count[b]; });
  std::vector<Index> reference(components.size(), -1);  // the largest group of every component
  Index labels = 1;
  for (const Index g : order) {
    Index& of_component = reference[components.label[first[g]]];
    if (of_component < 0) of_component = g;
    const bool same = squared_chord(turn[first[g]], turn[first[of_component]]) <= most;
    rank[g] = same ? 0 : labels++;
  }
  for (Index& g : group) g = rank[g];
  return group;
}

/// Turns every component of an answer so that its largest group is as in another.
/// @param component (n,) labels from 0 on
/// @param group as of shared_groups
inline void adopt_gauge(const std::vector<Index>& component, const std::vector<Index>& group,
                        const Rotations& R, Rotations& S) {
  const Index components = 1 + *std::max_element(component.begin(), component.end());
  Rotations gauge(static_cast<std::size_t>(components), Matrix3::Zero());
  for (std::size_t i = 0; i < R.size(); ++i) {
    Matrix3& turn = gauge[component[i]];
    if (group[i] == 0 && turn.isZero()) turn = R[i] * S[i].transpose();
  }
  for (std::size_t i = 0; i < R.size(); ++i) S[i] = gauge[component[i]] * S[i];
}

/// What there is to tell of another answer.
///
/// @param x, other_x squared residuals (m,) of the two, in units of the noise
/// @param group as of shared_groups
inline Alternative alternative_story(const MeasurementGraph& graph, const Rotations& R,
                                     const std::vector<double>& x, Rotations S,
                                     const std::vector<double>& other_x, std::vector<Index> group) {
  constexpr double most = contradiction;
  constexpr std::size_t most_missing = 16, most_bundles = 8, most_looked_at = 400;
  Alternative story;
  adopt_gauge(connected_components(graph).label, group, R, S);
  std::map<std::pair<Index, Index>, Bundle> bundles;
  std::vector<Index> only_other;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge& e = graph.edges()[k];
    if (group[e.i] == group[e.j]) continue;
    const double gain = std::min(other_x[k], most) - std::min(x[k], most);
    if (std::abs(gain) <= 0.5 * most) continue;
    const auto ends = std::minmax(group[e.i], group[e.j]);
    Bundle& bundle = bundles[{ends.first, ends.second}];
    bundle.group = ends.first;
    bundle.other_group = ends.second;
    (gain > 0.0 ? bundle.edges : bundle.alternative_edges) += 1;
    (gain > 0.0 ? bundle.weight : bundle.alternative_weight) += e.weight;
    if (gain < 0.0) only_other.push_back(k);
  }
  for (const auto& [ends, bundle] : bundles) story.bundles.push_back(bundle);
  std::stable_sort(story.bundles.begin(), story.bundles.end(),
                   [](const Bundle& a, const Bundle& b) {
                     return a.weight + a.alternative_weight > b.weight + b.alternative_weight;
                   });
  if (story.bundles.size() > most_bundles) story.bundles.resize(most_bundles);

  // Of an edge i j that only the other explains: which neighbours of i do not match j?
  std::vector<bool> near(graph.num_nodes(), false);
  const std::size_t stride = 1 + only_other.size() / most_looked_at;
  for (std::size_t k = 0; k < only_other.size(); k += stride) {
    if (story.missing.size() == most_missing) break;
    const Edge& e = graph.edges()[only_other[k]];
    for (const HalfEdge& h : graph.row(e.j)) near[h.node] = true;
    for (const HalfEdge& h : graph.row(e.i)) {
      if (near[h.node] || h.node == e.j || group[h.node] != group[e.i]) continue;
      story.missing.emplace_back(h.node, e.j);
      break;  // one of each edge
    }
    for (const HalfEdge& h : graph.row(e.j)) near[h.node] = false;
  }
  story.rotations = std::move(S);
  story.group = std::move(group);
  return story;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

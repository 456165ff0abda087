#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Which edges check one another, by the cycles of the graph alone. A bridge is in no cycle. Two
/// edges are in series if every cycle through one of them passes through the other: what the
/// measurements of a series say together is all that can be checked, so that it counts as one
/// measurement, whose variance is the sum of its edges'.
struct Series {
  std::vector<Index> label;  ///< (m,) the series of each edge; -1 for bridges and what was left out
  Index size = 0;            ///< how many series there are
  Index num_cycles = 0;      ///< independent cycles, m - n + components

  /// The share of the series that can be checked: each cycle checks one.
  double freedom() const { return size > 0 ? static_cast<double>(num_cycles) / size : 0.0; }
};

namespace detail {

/// Numbers that look random (the last steps of Steele, Lea and Flood's SplitMix64, 2014).
inline std::uint64_t scrambled(std::uint64_t k) {
  k += 0x9e3779b97f4a7c15;
  k = (k ^ (k >> 30)) * 0xbf58476d1ce4e5b9;
  k = (k ^ (k >> 27)) * 0x94d049bb133111eb;
  return k ^ (k >> 31);
}

}  // namespace detail

/// By sampling the cycle space (Pritchard and Thurimella 2011): edges that close a cycle with a
/// spanning forest get random labels of 64 bits, and an edge of the forest the exclusive or of all
/// those whose cycles pass through it. Bridges have the label 0 and edges in series the same one;
/// that others have by chance has a probability below m^2 / 2^64.
///
/// @param left_out (m,) edges that are as if they were not there; empty for none
inline Series series_of(const MeasurementGraph& graph, const std::vector<bool>& left_out = {}) {
  const BreadthFirstForest forest = breadth_first_forest(graph, left_out);
  std::vector<bool> in_tree(graph.edges().size(), false);
  for (const Index edge : forest.tree_edge) {
    if (edge >= 0) in_tree[edge] = true;
  }

  Series series;
  std::vector<std::uint64_t> below(forest.order.size(), 0), bits(graph.edges().size(), 0);
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (in_tree[k] || (!left_out.empty() && left_out[k])) continue;
    const Edge& e = graph.edges()[k];
    bits[k] = detail::scrambled(static_cast<std::uint64_t>(k));
    below[e.i] ^= bits[k];
    below[e.j] ^= bits[k];
    ++series.num_cycles;
  }
  for (auto node = forest.order.rbegin(); node != forest.order.rend(); ++node) {
    if (forest.parent[*node] < 0) continue;
    bits[forest.tree_edge[*node]] = below[*node];
    below[forest.parent[*node]] ^= below[*node];
  }

  // Two edges outside the forest are on different cycles: only the forest's labels occur twice.
  constexpr Index none = -1;
  std::unordered_map<std::uint64_t, Index> label_of;
  for (const Index edge : forest.tree_edge) {
    if (edge >= 0) label_of.emplace(bits[edge], none);
  }
  series.label.reserve(bits.size());
  for (const std::uint64_t b : bits) {
    if (b == 0) {
      series.label.push_back(none);
      continue;
    }
    const auto found = label_of.find(b);
    const bool is_new = found == label_of.end() || found->second == none;
    if (is_new && found != label_of.end()) found->second = series.size;
    series.label.push_back(is_new ? series.size : found->second);
    series.size += is_new;
  }
  return series;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

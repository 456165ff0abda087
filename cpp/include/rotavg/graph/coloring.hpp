#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The nodes by colours, such that no edge joins two of one colour: those can be updated at once.
struct Coloring {
  std::vector<Index> node;         ///< (n,) colour by colour, rising within each
  std::vector<Index> start = {0};  ///< (colours + 1,) where each colour begins in `node`

  Index num_colors() const { return static_cast<Index>(start.size()) - 1; }
};

/// Each node in turn takes the first colour that none of its neighbours has: at most one colour
/// more than the largest number of neighbours.
inline Coloring greedy_coloring(const MeasurementGraph& graph) {
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  std::vector<Index> color(n, -1), taken_by;
  Coloring coloring;
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    for (const HalfEdge& h : graph.row(i)) {
      if (color[h.node] >= 0) taken_by[color[h.node]] = i;
    }
    const auto free =
        std::find_if(taken_by.begin(), taken_by.end(), [i](Index k) { return k != i; });
    color[i] = static_cast<Index>(free - taken_by.begin());
    if (free == taken_by.end()) {
      taken_by.push_back(-1);
      coloring.start.push_back(0);
    }
    ++coloring.start[color[i] + 1];
  }
  for (Index c = 0; c < coloring.num_colors(); ++c) coloring.start[c + 1] += coloring.start[c];
  std::vector<Index> next(coloring.start.begin(), coloring.start.end() - 1);
  coloring.node.resize(n);
  for (Index i = 0; i < graph.num_nodes(); ++i) coloring.node[next[color[i]]++] = i;
  return coloring;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

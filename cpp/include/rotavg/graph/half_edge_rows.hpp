#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The rows of a graph with all their half-edges one behind the other: 80 bytes an edge, for loops
/// that go through them many times. The graph itself holds a rotation once, and on large graphs the
/// edges of a node lie far apart, so that to gather them takes several times as long as to read
/// them in order.
class HalfEdgeRows {
 public:
  class Row {
   public:
    Row(const HalfEdge* begin, const HalfEdge* end) : begin_(begin), end_(end) {}
    const HalfEdge* begin() const { return begin_; }
    const HalfEdge* end() const { return end_; }
    Index size() const { return static_cast<Index>(end_ - begin_); }

   private:
    const HalfEdge* begin_;
    const HalfEdge* end_;
  };

  /// The graph may be gone, or have other weights, later: these stay.
  explicit HalfEdgeRows(const MeasurementGraph& graph) {
    const auto n = static_cast<std::size_t>(graph.num_nodes());
    start_.reserve(n + 1);
    half_edges_.reserve(2 * graph.edges().size());
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      start_.push_back(half_edges_.size());
      for (const HalfEdge& h : graph.row(l)) half_edges_.push_back(h);
    }
    start_.push_back(half_edges_.size());
  }

  Index num_nodes() const { return static_cast<Index>(start_.size()) - 1; }
  Index num_edges() const { return static_cast<Index>(half_edges_.size() / 2); }
  /// As MeasurementGraph::row.
  Row row(Index l) const {
    return {half_edges_.data() + start_[l], half_edges_.data() + start_[l + 1]};
  }

 private:
  std::vector<std::size_t> start_;
  std::vector<HalfEdge> half_edges_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

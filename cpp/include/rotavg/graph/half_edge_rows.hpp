#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/huge_pages.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The rows of a graph with their half-edges one behind the other: 80 bytes an edge, for loops
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
  /// @param order (n,) all nodes, in the order in which loops go through them; by default that of
  ///        the graph
  explicit HalfEdgeRows(const MeasurementGraph& graph, const std::vector<Index>* order = nullptr) {
    LargeVector<HalfEdge>& half_edges = parts_.emplace_back();
    half_edges.reserve(2 * graph.edges().size());  // which then stay where they are
    rows_.assign(static_cast<std::size_t>(graph.num_nodes()), {nullptr, nullptr});
    for (Index k = 0; k < graph.num_nodes(); ++k) {
      const Index l = order ? (*order)[static_cast<std::size_t>(k)] : k;
      const HalfEdge* const begin = half_edges.data() + half_edges.size();
      for (const HalfEdge& h : graph.row(l)) half_edges.push_back(h);
      rows_[static_cast<std::size_t>(l)] = {begin, half_edges.data() + half_edges.size()};
    }
  }
  /// Of some nodes alone: row(k) is that of nodes[k].
  struct Only {
    const std::vector<Index>& nodes;
  };
  HalfEdgeRows(const MeasurementGraph& graph, Only only) {
    std::size_t size = 0;
    for (const Index l : only.nodes) size += static_cast<std::size_t>(graph.row(l).size());
    LargeVector<HalfEdge>& half_edges = parts_.emplace_back();
    half_edges.reserve(size);  // which then stay where they are
    rows_.reserve(only.nodes.size());
    for (const Index l : only.nodes) {
      const HalfEdge* const begin = half_edges.data() + half_edges.size();
      for (const HalfEdge& h : graph.row(l)) half_edges.push_back(h);
      rows_.emplace_back(begin, half_edges.data() + half_edges.size());
    }
  }
  /// Of half-edges that were made elsewhere, in parts: those of the first rows, and so on.
  /// @param row_sizes of all parts
  HalfEdgeRows(std::vector<LargeVector<HalfEdge>> parts,
               const std::vector<std::vector<Index>>& row_sizes)
      : parts_(std::move(parts)) {
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      const HalfEdge* begin = parts_[p].data();
      for (const Index size : row_sizes[p]) {
        rows_.emplace_back(begin, begin + size);
        begin += size;
      }
    }
  }
  HalfEdgeRows(const HalfEdgeRows&) = delete;
  HalfEdgeRows& operator=(const HalfEdgeRows&) = delete;

  Index num_nodes() const { return static_cast<Index>(rows_.size()); }
  Index num_edges() const {
    std::size_t ends = 0;
    for (const auto& part : parts_) ends += part.size();
    return static_cast<Index>(ends / 2);
  }
  /// As MeasurementGraph::row.
  const Row& row(Index l) const { return rows_[static_cast<std::size_t>(l)]; }

 private:
  std::vector<LargeVector<HalfEdge>> parts_;
  std::vector<Row> rows_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

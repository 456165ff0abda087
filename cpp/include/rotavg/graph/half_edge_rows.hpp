#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/threads.hpp>
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
  explicit HalfEdgeRows(const MeasurementGraph& graph, const std::vector<Index>* order = nullptr,
                        int num_threads = 1)
      : rows_(graph.nodes().size(), Row{nullptr, nullptr}) {
    const auto node = [order](Index k) { return order ? (*order)[k] : k; };
    gather(graph, num_nodes(), num_threads, node, node);
  }
  /// Of some nodes alone: row(k) is that of nodes[k].
  struct Only {
    const std::vector<Index>& nodes;
  };
  HalfEdgeRows(const MeasurementGraph& graph, Only only, int num_threads = 1)
      : rows_(only.nodes.size(), Row{nullptr, nullptr}) {
    gather(
        graph, num_nodes(), num_threads, [&](Index k) { return only.nodes[k]; },
        [](Index k) { return k; });
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
  /// The rows of node_at(0), node_at(1) … as row(row_at(0)) and so on, each thread a part of them.
  template <typename NodeAt, typename RowAt>
  void gather(const MeasurementGraph& graph, Index count, int num_threads, const NodeAt& node_at,
              const RowAt& row_at) {
    const int parts = std::max(
        1, std::min(resolve_num_threads(num_threads, graph.num_edges()), static_cast<int>(count)));
    parts_.resize(static_cast<std::size_t>(parts));
    std::vector<Index> begin{0};
    for (int p = 0; p < parts; ++p) {
      begin.push_back(static_cast<Index>(static_cast<long long>(count) * (p + 1) / parts));
      std::size_t size = 0;
      for (Index k = begin[p]; k < begin[p + 1]; ++k) {
        size += static_cast<std::size_t>(graph.row(node_at(k)).size());
      }
      parts_[p].reserve(size);  // which then stays where it is
    }
    parallel_for(parts, parts, [&](Index p) {
      LargeVector<HalfEdge> half_edges(std::move(parts_[p]));  // no line of the cache is shared
      for (Index k = begin[p]; k < begin[p + 1]; ++k) {
        const HalfEdge* const row = half_edges.data() + half_edges.size();
        for (const HalfEdge& h : graph.row(node_at(k))) half_edges.push_back(h);
        rows_[row_at(k)] = {row, half_edges.data() + half_edges.size()};
      }
      parts_[p] = std::move(half_edges);
    });
  }

  std::vector<LargeVector<HalfEdge>> parts_;
  std::vector<Row> rows_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the edges at every node add up to, with the same bits for any number of threads. On sparse
/// graphs every node gathers from its edges. On dense ones, where a node's edges lie far apart and
/// there are few nodes, parts of the edges are scattered, each into sums of its own, so that every
/// edge is read once.
///
/// @param add_end `add_end(half_edge, Sum& sum)` adds an edge to the sum at one of its ends
/// @param add_edge `add_edge(k, Sum& at_i, Sum& at_j)` adds edge k at both
/// @tparam Sum with a default constructor that makes zero, and operator+=
template <typename Sum, typename AddEnd, typename AddEdge>
std::vector<Sum> sums_at_nodes(const MeasurementGraph& graph, int num_threads, AddEnd&& add_end,
                               AddEdge&& add_edge) {
  constexpr Index parts = 16;
  constexpr double many = 100.0;  // edges for every node: the parts' own sums cost little beside
  const Index n = graph.num_nodes(), m = graph.num_edges();
  std::vector<Sum> sums(static_cast<std::size_t>(n));
  if (m < many * n) {
    parallel_for(n, num_threads, [&](Index l) {
      Sum sum{};  // in registers
      for (const HalfEdge& h : graph.row(l)) add_end(h, sum);
      sums[l] = sum;
    });
    return sums;
  }
  std::vector<std::vector<Sum>> by_part(parts);
  const auto begin_of = [&](Index part) {
    return static_cast<Index>(static_cast<long long>(m) * part / parts);
  };
  Team::run(
      parts, num_threads,
      [&](Index part) {
        std::vector<Sum>& own = by_part[part];
        own.resize(static_cast<std::size_t>(n));
        const auto& edges = graph.quaternion_edges();
        const Index end = begin_of(part + 1);
        // Often edges from one node follow one another: its sum stays in registers meanwhile.
        Index i = -1;
        Sum at_i{};
        for (Index k = begin_of(part); k < end; ++k) {
          prefetch_ahead(edges, k);
          if (edges[k].i != i) {
            if (i >= 0) own[i] += at_i;
            i = edges[k].i;
            at_i = Sum{};
          }
          add_edge(k, at_i, own[edges[k].j]);
        }
        if (i >= 0) own[i] += at_i;
      },
      [] {});
  parallel_for(n, num_threads, [&](Index l) {
    for (const std::vector<Sum>& own : by_part) sums[l] += own[l];
  });
  return sums;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

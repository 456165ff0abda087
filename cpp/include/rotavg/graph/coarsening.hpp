#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Nodes in groups of two or more that move as one: R_i = Q_g(i) C_i, with C_i a product of
/// measurements, so that what rides together fits exactly.
struct NodeGroups {
  Index count = 0;
  std::vector<Index> group;     ///< (n,) g(i)
  Quaternions group_from_node;  ///< (n,) of C_i

  /// Of the nodes from those of their groups.
  Quaternions nodes_from(const Quaternions& Q) const {
    Quaternions q;
    q.reserve(group.size());
    for (std::size_t i = 0; i < group.size(); ++i) {
      q.push_back(Quaternion(product(Q[group[i]], group_from_node[i])).normalized());
    }
    return q;
  }
};

/// Heavy-edge matching (Karypis and Kumar 1998): every node, one after the other, along its
/// heaviest edge to a neighbour that is still alone. Who finds none joins the group of the
/// neighbour at its heaviest edge; who has no edges, so that its rotation is free, the first group.
/// There are no groups where nobody has edges.
/// @tparam Rows MeasurementGraph or HalfEdgeRows
template <typename Rows>
NodeGroups heavy_edge_matching(const Rows& rows) {
  const Index n = rows.num_nodes();
  NodeGroups groups;
  groups.group.assign(static_cast<std::size_t>(n), -1);
  groups.group_from_node.assign(groups.group.size(), Quaternion::Identity());
  const auto heaviest = [&](Index i, bool to_the_free) {
    HalfEdge found{};
    double most = 0.0;
    found.node = -1;
    for (const HalfEdge& h : rows.row(i)) {
      const double weight = h.node_from_l.squaredNorm();
      if (!(weight > most) || (to_the_free && groups.group[h.node] >= 0)) continue;
      most = weight;
      found = h;
    }
    return found;
  };
  for (Index i = 0; i < n; ++i) {
    if (groups.group[i] >= 0) continue;
    if (const HalfEdge h = heaviest(i, /*to_the_free=*/true); h.node >= 0) {
      groups.group[i] = groups.group[h.node] = groups.count++;
      groups.group_from_node[h.node] = Quaternion(conjugated(h.node_from_l)).normalized();
    } else if (const HalfEdge other = heaviest(i, /*to_the_free=*/false); other.node >= 0) {
      groups.group[i] = groups.group[other.node];
      groups.group_from_node[i] =
          Quaternion(product(groups.group_from_node[other.node], other.node_from_l)).normalized();
    } else {
      groups.group[i] = 0;
    }
  }
  return groups;
}

namespace detail {

/// coarse_rows() of the groups from `begin` to before `end`.
/// @param into receives their half-edges; may have memory for them
/// @param row_sizes receives how many of these each has
/// @param start (groups + 1,) where the members of each group begin
template <typename Rows>
void append_coarse_rows(const Rows& rows, const NodeGroups& groups, const std::vector<Index>& start,
                        const std::vector<Index>& members, Index begin, Index end,
                        LargeVector<HalfEdge>& into, std::vector<Index>& row_sizes) {
  // Vectors of different threads share a line of the cache.
  LargeVector<HalfEdge> half_edges(std::move(into));
  row_sizes.assign(static_cast<std::size_t>(end - begin), 0);
  std::vector<Index> place(static_cast<std::size_t>(groups.count), -1);  // in the row
  for (Index a = begin; a < end; ++a) {
    const std::size_t row_start = half_edges.size();
    for (Index k = start[a]; k < start[a + 1]; ++k) {
      const Index l = members[k];
      const Quaternion node_from_group = groups.group_from_node[l].conjugate();
      for (const HalfEdge& h : rows.row(l)) {
        const Index b = groups.group[h.node];
        if (b == a) continue;
        Vector4 q = product(Quaternion(product(groups.group_from_node[h.node], h.node_from_l)),
                            node_from_group);
        q *= std::sqrt(q.squaredNorm());  // from sqrt(w) to w
        if (place[b] < 0) {
          place[b] = static_cast<Index>(half_edges.size() - row_start);
          half_edges.push_back({WeightedQuaternion(q), b, 0});
          continue;
        }
        auto& sum = half_edges[row_start + place[b]].node_from_l.coeffs();
        if (sum.dot(q) < 0.0) q = -q;  // the same rotation
        sum += q;
      }
    }
    for (std::size_t k = row_start; k < half_edges.size(); ++k) {
      HalfEdge& h = half_edges[k];
      place[h.node] = -1;
      const double weight = h.node_from_l.norm();
      if (weight > 0.0) h.node_from_l.coeffs() /= std::sqrt(weight);
    }
    row_sizes[a - begin] = static_cast<Index>(half_edges.size() - row_start);
  }
  into = std::move(half_edges);
}

}  // namespace detail

/// What the edges between groups say: R_i R_ij ~ R_j is Q_a (C_i R_ij C_j^T) ~ Q_b, and the edges
/// of two groups become one, the mean of their quaternions; its weight is the length of their
/// weighted sum, which is less where they contradict one another. (Where three or more do, the two
/// ends may see different means.)
/// @returns the rows of the groups
template <typename Rows>
HalfEdgeRows coarse_rows(const Rows& rows, const NodeGroups& groups, int num_threads = 1) {
  std::vector<Index> start(static_cast<std::size_t>(groups.count) + 1, 0);
  std::vector<Index> members(groups.group.size());
  for (const Index g : groups.group) ++start[g + 1];
  for (Index g = 0; g < groups.count; ++g) start[g + 1] += start[g];
  std::vector<Index> next(start.begin(), start.end() - 1);
  for (Index i = 0; i < rows.num_nodes(); ++i) members[next[groups.group[i]]++] = i;

  const int parts = std::min(resolve_num_threads(num_threads, rows.num_edges()), groups.count);
  // Reserved here, so that the allocator can reuse what this thread freed before.
  std::vector<LargeVector<HalfEdge>> half_edges(static_cast<std::size_t>(parts));
  for (auto& part : half_edges) {
    part.reserve(2 * static_cast<std::size_t>(rows.num_edges()) / half_edges.size());
  }
  std::vector<std::vector<Index>> row_sizes(half_edges.size());
  const auto bound = [&](Index part) {
    return static_cast<Index>(static_cast<long long>(groups.count) * part / parts);
  };
  parallel_for(parts, parts, [&](Index part) {
    detail::append_coarse_rows(rows, groups, start, members, bound(part), bound(part + 1),
                               half_edges[part], row_sizes[part]);
  });
  return HalfEdgeRows(std::move(half_edges), row_sizes);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

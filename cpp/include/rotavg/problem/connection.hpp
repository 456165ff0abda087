#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/cholesky.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Lower triangle of blockdiag(diagonal) - Rt for one component, without its first `skipped` nodes.
/// With the degrees on the diagonal it is the connection Laplacian; with Lambda, the matrix S of
/// Theorem 1. All share one sparsity pattern.
///
/// @param diagonal symmetric blocks, one for each node of the component
inline SparseSymmetric diagonal_minus_measurements(const MeasurementGraph& graph,
                                                   const Components& components, Index component,
                                                   const std::vector<Matrix3>& diagonal,
                                                   Index skipped) {
  const std::vector<Index>& nodes = components.nodes[component];
  const auto n = static_cast<Index>(nodes.size());
  SparseSymmetric A(3 * (n - skipped), 3 * (n - skipped));
  Eigen::Index blocks = 0;
  for (Index a = skipped; a < n; ++a) blocks += 2 + graph.row(nodes[a]).size();
  A.reserve(9 * blocks / 2);
  std::vector<std::pair<Index, const HalfEdge*>> below;
  for (Index a = skipped; a < n; ++a) {
    below.clear();
    for (const HalfEdge& h : graph.row(nodes[a])) {
      const Index b = components.row_in_component[h.node];
      if (b > a) below.emplace_back(b, &h);
    }
    std::stable_sort(below.begin(), below.end(),
                     [](const auto& x, const auto& y) { return x.first < y.first; });
    // Column 3a + c: the diagonal block from the diagonal down, then -Rt_ba for each b below.
    for (int c = 0; c < 3; ++c) {
      const int column = 3 * (a - skipped) + c;
      A.startVec(column);
      for (int r = c; r < 3; ++r) A.insertBack(column - c + r, column) = diagonal[a](r, c);
      for (std::size_t k = 0; k < below.size();) {
        const Index b = below[k].first;
        Vector3 sum = Vector3::Zero();  // parallel edges add up
        for (; k < below.size() && below[k].first == b; ++k) {
          sum -= below[k].second->block.row(c).transpose();  // Rt_ba = Rt_ab^T
        }
        for (int r = 0; r < 3; ++r) A.insertBack(3 * (b - skipped) + r, column) = sum(r);
      }
    }
  }
  A.finalize();
  return A;
}

}  // namespace rotavg

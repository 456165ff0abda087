#pragma once

#include <functional>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/cholesky.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The chordal initial value (Martinec and Pajdla 2007): the minimiser of (3) over free 3 x 3
/// matrices M_i, the first of each component held at I, and then the nearest rotations. With X_i =
/// M_i^T, the rest solve the connection Laplacian, (D (x) I - Rt) X = 0: one sparse factorisation.
/// Exact without noise, and far better than any tree where the noise is large.
///
/// @param max_flops where a factorisation would take more, there is no result
/// @param keep_going asked every few milliseconds; where it says false, there is no result
inline std::optional<Rotations> chordal_init(const MeasurementGraph& graph,
                                             const Components& components, double max_flops = 2e10,
                                             const std::function<bool()>& keep_going = {}) {
  Rotations R(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  for (Index c = 0; c < components.size(); ++c) {
    const std::vector<Index>& nodes = components.nodes[c];
    if (nodes.size() < 2) continue;
    std::vector<Matrix3> degrees;
    for (const Index i : nodes) degrees.push_back(graph.degree(i) * Matrix3::Identity());
    const SparseSymmetric laplacian = diagonal_minus_measurements(graph, components, c, degrees, 1);
    SparseCholesky cholesky(laplacian);
    if (cholesky.flops() > max_flops || cholesky.factorize(laplacian, 0.0, keep_going) !=
                                            SparseCholesky::Outcome::positive_definite) {
      return std::nullopt;
    }
    Eigen::MatrixXd from_root = Eigen::MatrixXd::Zero(laplacian.rows(), 3);  // Rt_i,root X_root
    for (const HalfEdge& h : graph.row(nodes.front())) {
      from_root.middleRows<3>(3 * (components.row_in_component[h.node] - 1)) += h.block.transpose();
    }
    const Eigen::MatrixXd X = cholesky.solve(from_root);
    for (std::size_t a = 1; a < nodes.size(); ++a) {
      const Matrix3 M = X.middleRows<3>(3 * (static_cast<Eigen::Index>(a) - 1)).transpose();
      R[nodes[a]] = nearest_rotation(M);
    }
  }
  return R;
}

}  // namespace rotavg

#pragma once

#include <functional>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The chordal initial value (Martinec and Pajdla 2007): the minimiser of (3) over free 3 x 3
/// matrices M_i, the first of each component held at I, and then the nearest rotations. With X_i =
/// M_i^T, the rest solve the connection Laplacian, (D (x) I - Rt) X = 0: one sparse factorisation.
/// Exact without noise, and far better than any tree where the noise is large.
///
/// With noise X falls off with the distance from the root, on long thin graphs until nothing is
/// left of it. From those nodes that it has reached it goes on as a step of inverse iteration, (D
/// (x) I - Rt) X = D R^T, in which the others have R = 0.
///
/// @param eliminations of all components, without their roots
/// @param max_flops where a factorisation would take more, there is no result
/// @param keep_going asked every few milliseconds; where it says false, there is no result
inline std::optional<Rotations> chordal_init(const MeasurementGraph& graph,
                                             std::vector<Elimination>& eliminations,
                                             double max_flops = 5e10,
                                             const std::function<bool()>& keep_going = {}) {
  constexpr double vanishing = 1e-200;  // what is smaller loses digits
  Rotations R(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  std::vector<Index> row(R.size(), -1);
  for (Elimination& elimination : eliminations) {
    if (elimination.size() == 0) continue;
    if (elimination.flops(3, max_flops) > max_flops) return std::nullopt;
    BlockCholesky<3> cholesky(elimination.symbolic(), elimination.num_threads());
    if (cholesky.factorize(connection_laplacian(graph, elimination), 0.0, keep_going) !=
        CholeskyOutcome::positive_definite) {
      return std::nullopt;
    }
    for (Index a = 0; a < elimination.size(); ++a) row[elimination.node(a)] = a;
    Eigen::MatrixXd X = Eigen::MatrixXd::Zero(cholesky.size(), 3);
    for (const HalfEdge& h : graph.row(elimination.root())) {  // Rt_i,root X_root
      const Matrix3 block = graph.block(h);
      for (int k = 0; k < 9; ++k) X(3 * row[h.node] + k / 3, k % 3) += block(k);
    }
    std::vector<bool> is_reached(static_cast<std::size_t>(elimination.size()), false);
    for (Index reached = 0; reached < elimination.size();) {
      if (keep_going && !keep_going()) return std::nullopt;
      cholesky.solve_in_place(X);
      const Index before = reached;
      for (Index a = 0; a < elimination.size(); ++a) {
        const Matrix3 M = transposed_block(X, a);
        if (is_reached[a] || !(M.cwiseAbs().maxCoeff() > vanishing)) continue;
        is_reached[a] = true;
        ++reached;
        R[elimination.node(a)] = nearest_rotation(M);
      }
      if (reached == before) return std::nullopt;
      if (reached == elimination.size()) break;
      for (Index a = 0; a < elimination.size(); ++a) {
        const Index i = elimination.node(a);
        for (int k = 0; k < 9; ++k) {
          X(3 * a + k / 3, k % 3) = is_reached[a] ? graph.degree(i) * R[i](k % 3, k / 3) : 0.0;
        }
      }
    }
  }
  return R;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

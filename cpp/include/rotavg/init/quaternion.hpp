#pragma once

#include <functional>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The quaternion start (Govindu 2001): each measurement is a linear equation x_i q_ij = x_j in
/// free quaternions, the first of each component held at 1; their weighted least squares,
///
///     minimise sum_E w_ij |x_i q_ij - x_j|^2,
///
/// are solved, and the x_i scaled to length one. With M_ij the matrix of x -> x q_ij, the normal
/// equations are deg_i x_i - sum_{(i,j)} w M_ij^T x_j - sum_{(j,i)} w M_ji x_j = 0, a connection
/// Laplacian of 4 x 4 blocks: one sparse factorisation. Exact without noise.
///
/// A rotation is two quaternions, q and -q, so the signs of the q_ij have to fit together. They are
/// chosen so that <x_i q_ij, x_j> > 0 at the shortest-path value. That is right for every edge
/// whose cycle through the tree of shortest paths closes up to less than half a turn.
///
/// @param eliminations of all components, without their roots
/// @param max_flops where a factorisation would take more, there is no result
/// @param keep_going asked every few milliseconds; where it says false, there is no result
inline std::optional<Rotations> quaternion_init(const MeasurementGraph& graph,
                                                std::vector<Elimination>& eliminations,
                                                double max_flops = 5e10,
                                                const std::function<bool()>& keep_going = {}) {
  Quaternions q = to_quaternions(shortest_path_init(graph));
  std::vector<Matrix4> M(graph.edges().size());  // w_ij M_ij, with the chosen sign
  for (std::size_t k = 0; k < M.size(); ++k) {
    const QuaternionEdge& e = graph.quaternion_edges()[k];
    const double scale = e.i_from_j.norm();
    const bool opposite = product(q[e.i], e.i_from_j).dot(q[e.j].coeffs()) < 0.0;
    for (int c = 0; c < 4; ++c) {
      const Vector4 column = product(Quaternion(c == 3, c == 0, c == 1, c == 2), e.i_from_j);
      for (int r = 0; r < 4; ++r) M[k](r, c) = (opposite ? -scale : scale) * column(r);
    }
  }
  std::vector<Index> row(q.size(), -1);
  for (Elimination& elimination : eliminations) {
    if (elimination.size() == 0) continue;
    if (elimination.flops(4, max_flops) > max_flops) return std::nullopt;
    BlockCholesky<4> cholesky(elimination.symbolic(), elimination.num_threads());
    const auto laplacian = elimination.assemble<4>(
        [&](Index i) {
          Matrix4 block = Matrix4::Zero();
          for (int r = 0; r < 4; ++r) block(r, r) = graph.degree(i);
          return block;
        },
        [&](Index k) {
          Matrix4 block;
          for (int r = 0; r < 16; ++r) block(r) = -M[k](r % 4 * 4 + r / 4);
          return block;
        });
    if (cholesky.factorize(laplacian, 0.0, keep_going) != CholeskyOutcome::positive_definite) {
      return std::nullopt;
    }
    for (Index a = 0; a < elimination.size(); ++a) row[elimination.node(a)] = a;
    Eigen::MatrixXd x = Eigen::MatrixXd::Zero(cholesky.size(), 1);
    for (const HalfEdge& h : graph.row(elimination.root())) {  // what multiplies x_root = 1
      const Matrix4& block = M[h.edge()];
      for (int r = 0; r < 4; ++r) x(4 * row[h.node] + r) += h.is_i() ? block(r, 3) : block(3, r);
    }
    cholesky.solve_in_place(x);
    for (Index a = 0; a < elimination.size(); ++a) {
      Vector4 x_a(x(4 * a), x(4 * a + 1), x(4 * a + 2), x(4 * a + 3));
      // Far from the root, noise can let x vanish to the last digit: there the value above stays.
      const double largest = x_a.cwiseAbs().maxCoeff();  // whose square may vanish
      if (!(largest > 0.0)) continue;
      x_a /= largest;
      q[elimination.node(a)] = Quaternion(x_a).normalized();
    }
  }
  return to_rotations(q);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The variable of the semidefinite relaxation (6),
///
///     min -tr(Rt Y)  subject to  Y >= 0, Y_ii = I,
///
/// which has R^T R in the place of Y where R = [R_1 … R_n]. Dense: 72 n^2 bytes.
class SemidefiniteRelaxation {
 public:
  /// Starts at Y = (I + R^T R) / 2. From R^T R alone it would never leave rank 3, and minimising a
  /// block would be a step of BCD, but over O(3).
  ///
  /// @param graph must outlive this object
  /// @throws TooLarge if Y does not fit in memory
  SemidefiniteRelaxation(const MeasurementGraph& graph, const Rotations& R, int num_threads)
      : graph_(graph), num_threads_(num_threads) {
    const Index n = graph.num_nodes();
    const double bytes = 72.0 * n * n, available = physical_memory();
    if (bytes > available) {
      std::ostringstream message;
      message.precision(3);
      message << "the semidefinite relaxation of " << n << " nodes is a dense matrix of "
              << bytes * 1e-9 << " GB, and this machine has " << available * 1e-9 << " GB";
      throw TooLarge(message.str());
    }
    Y_.resize(3 * Eigen::Index{n}, 3 * Eigen::Index{n});
    S_.resize(Y_.rows(), 3);
    parallel_for(n, num_threads_, [&](Index j) {
      for (Index i = 0; i < n; ++i) {
        block(i, j) = 0.5 * transposed_product(R[i], R[j]);
      }
      block(j, j).setIdentity();
    });
  }

  /// Minimises over block row and column k, the rest fixed (Eriksson et al. 2018, Algorithm 1):
  /// with W the measured column k of Rt and B the rest of Y,
  ///
  ///     Y_k = S = B W [(W^T B W)^(1/2)]^+.
  ///
  /// Y stays positive semidefinite, as S^T B^+ S is a projection. A node without edges keeps what
  /// it has.
  ///
  /// @returns |Y - Y'|_F^2
  double minimize_block(Index k) {
    if (graph_.row(k).size() == 0) return 0.0;
    S_from_measured_column(k);

    Matrix3 M = Matrix3::Zero();  // W^T B W
    for (const HalfEdge& h : graph_.row(k)) {
      const Matrix3 W_q = measured(h, k), S_q = S_.middleRows<3>(3 * Eigen::Index{h.node});
      M += transposed_product(W_q, S_q);
    }
    const Matrix3 root = inverse_root(symmetric_part(M));
    for (Eigen::Index row = 0; row < S_.rows(); ++row) {
      const double s[3] = {S_(row, 0), S_(row, 1), S_(row, 2)};
      for (int c = 0; c < 3; ++c) {
        S_(row, c) = s[0] * root(0, c) + s[1] * root(1, c) + s[2] * root(2, c);
      }
    }
    const Eigen::Index at = 3 * Eigen::Index{k};
    S_.middleRows<3>(at).setIdentity();

    const double change = 2.0 * (S_ - Y_.middleCols<3>(at)).squaredNorm();
    Y_.middleCols<3>(at) = S_;
    Y_.middleRows<3>(at) = S_.transpose();
    return change;
  }

  /// The objective of (6) on the scale of (3): 6 sum w - tr(Rt Y), which is f(R) at Y = R^T R. Edge
  /// by edge, as that cancels least.
  double objective() const {
    const auto& edges = graph_.edges();
    return block_sum<double>(graph_.num_edges(), num_threads_, [&](Index k) {
      const Edge& e = edges[k];
      const Matrix3 Y_ij = block(e.i, e.j);
      return e.weight * (6.0 - 2.0 * e.i_from_j.cwiseProduct(Y_ij).sum());
    });
  }

  /// The rotations nearest to the block row of each component's first node.
  Rotations rotations(const Components& components) const {
    Rotations R(static_cast<std::size_t>(graph_.num_nodes()));
    parallel_for(graph_.num_nodes(), num_threads_, [&](Index i) {
      R[i] = nearest_rotation(block(components.root(components.label[i]), i));
    });
    return R;
  }

  const Eigen::MatrixXd& matrix() const { return Y_; }

 private:
  Eigen::Block<Eigen::MatrixXd, 3, 3> block(Index i, Index j) {
    return Y_.block<3, 3>(3 * Eigen::Index{i}, 3 * Eigen::Index{j});
  }
  Eigen::Block<const Eigen::MatrixXd, 3, 3> block(Index i, Index j) const {
    return Y_.block<3, 3>(3 * Eigen::Index{i}, 3 * Eigen::Index{j});
  }

  /// Rt_qk / deg_k of a half-edge of node k: the scale of W does not matter.
  Matrix3 measured(const HalfEdge& h, Index k) const {
    return weighted_rotation(h.node_from_l) / graph_.degree(k);
  }

  /// S = B W; its rows of node k are not used. A few rows at a time, which stay in the cache, and
  /// by products that start no threads of their own.
  void S_from_measured_column(Index k) {
    constexpr Eigen::Index panel = 256;
    const auto num_panels = static_cast<Index>((S_.rows() + panel - 1) / panel);
    parallel_for(num_panels, num_threads_, [&](Index p) {
      const Eigen::Index start = panel * p, rows = std::min(panel, S_.rows() - start);
      auto S = S_.middleRows(start, rows);
      S.setZero();
      for (const HalfEdge& h : graph_.row(k)) {
        const auto Y_q = Y_.middleCols<3>(3 * Eigen::Index{h.node}).middleRows(start, rows);
        S.noalias() += Y_q.lazyProduct(measured(h, k));
      }
    });
  }

  /// [M^(1/2)]^+ of a positive semidefinite matrix.
  static Matrix3 inverse_root(const Matrix3& M) {
    const SmallEigen eigen = small_eigen(M);
    const double rounding = 1e-14 * eigen.values(2);
    Matrix3 result = Matrix3::Zero();
    for (int k = 0; k < 3; ++k) {
      if (!(eigen.values(k) > rounding)) continue;
      const Vector3 v = eigen.vectors.col(k) / std::sqrt(std::sqrt(eigen.values(k)));
      result += outer_product(v, v);
    }
    return result;
  }

  const MeasurementGraph& graph_;
  int num_threads_;
  Eigen::MatrixXd Y_;
  Eigen::Matrix<double, Eigen::Dynamic, 3> S_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

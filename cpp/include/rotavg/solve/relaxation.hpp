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
              << bytes * 1e-9 << " GB, and this process may have " << available * 1e-9 << " GB";
      throw TooLarge(message.str());
    }
    Y_.resize(3 * Eigen::Index{n}, 3 * Eigen::Index{n});
    S_.resize(Y_.rows(), 3);
    parallel_for(n, num_threads_, [&](Index j) {
      for (Index i = 0; i < n; ++i) {
        const Matrix3 product = transposed_product(R[i], R[j]);
        for (int k = 0; k < 9; ++k) entry(i, j, k) = 0.5 * product(k);
      }
      for (int k = 0; k < 9; ++k) entry(j, j, k) = k % 4 == 0 ? 1.0 : 0.0;
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
      Matrix3 S_q;
      for (int a = 0; a < 9; ++a) S_q(a) = S_(3 * Eigen::Index{h.node} + a % 3, a / 3);
      M += transposed_product(measured(h, k), S_q);
    }
    const Matrix3 root = inverse_root(symmetric_part(M));
    for (Eigen::Index row = 0; row < S_.rows(); ++row) {
      const double s[3] = {S_(row, 0), S_(row, 1), S_(row, 2)};
      for (int c = 0; c < 3; ++c) {
        S_(row, c) = s[0] * root(0, c) + s[1] * root(1, c) + s[2] * root(2, c);
      }
    }
    const Eigen::Index at = 3 * Eigen::Index{k};
    for (int a = 0; a < 9; ++a) S_(at + a % 3, a / 3) = a % 4 == 0 ? 1.0 : 0.0;

    double change = 0.0;
    for (int c = 0; c < 3; ++c) {
      for (Eigen::Index row = 0; row < S_.rows(); ++row) {
        const double difference = S_(row, c) - Y_(row, at + c);
        change += difference * difference;
        Y_(row, at + c) = Y_(at + c, row) = S_(row, c);
      }
    }
    return 2.0 * change;
  }

  /// The objective of (6) on the scale of (3): 6 sum w - tr(Rt Y), which is f(R) at Y = R^T R. Edge
  /// by edge, as that cancels least.
  double objective() const {
    const auto& edges = graph_.edges();
    return block_sum<double>(graph_.num_edges(), num_threads_, [&](Index k) {
      const Edge& e = edges[k];
      const Matrix3 i_from_j = e.i_from_j();
      double trace = 0.0;
      for (int a = 0; a < 9; ++a) trace += i_from_j(a) * entry(e.i, e.j, a);
      return e.weight * (6.0 - 2.0 * trace);
    });
  }

  /// The rotations nearest to the block row of each component's first node.
  Rotations rotations(const Components& components) const {
    Rotations R(static_cast<std::size_t>(graph_.num_nodes()));
    parallel_for(graph_.num_nodes(), num_threads_, [&](Index i) {
      Matrix3 block;
      for (int a = 0; a < 9; ++a) {
        block(a) = entry(components.root(components.label[i]), i, a);
      }
      R[i] = nearest_rotation(block);
    });
    return R;
  }

  const Eigen::MatrixXd& matrix() const { return Y_; }

 private:
  /// Entry a of the block Y_ij, column by column.
  double& entry(Index i, Index j, int a) {
    return Y_(3 * Eigen::Index{i} + a % 3, 3 * Eigen::Index{j} + a / 3);
  }
  double entry(Index i, Index j, int a) const {
    return Y_(3 * Eigen::Index{i} + a % 3, 3 * Eigen::Index{j} + a / 3);
  }

  /// Rt_qk / deg_k of a half-edge of node k: the scale of W does not matter.
  Matrix3 measured(const HalfEdge& h, Index k) const {
    Matrix3 W = weighted_rotation(h.node_from_l);
    W /= graph_.degree(k);
    return W;
  }

  /// S = B W; its rows of node k are not used. A few rows at a time, which stay in the cache, and
  /// by products that start no threads of their own.
  void S_from_measured_column(Index k) {
    constexpr Eigen::Index panel = 256;
    const auto num_panels = static_cast<Index>((S_.rows() + panel - 1) / panel);
    parallel_for(num_panels, num_threads_, [&](Index p) {
      const Eigen::Index start = panel * p, rows = std::min(panel, S_.rows() - start);
      double* S[3];
      for (int c = 0; c < 3; ++c) {
        S[c] = S_.data() + c * S_.rows() + start;
        std::fill(S[c], S[c] + rows, 0.0);
      }
      for (const HalfEdge& h : graph_.row(k)) {
        const Matrix3 W = measured(h, k);
        const double* const Y = Y_.data() + 3 * Eigen::Index{h.node} * Y_.rows() + start;
        for (Eigen::Index row = 0; row < rows; ++row) {
          const double y_0 = Y[row], y_1 = Y[row + Y_.rows()], y_2 = Y[row + 2 * Y_.rows()];
          for (int c = 0; c < 3; ++c) S[c][row] += y_0 * W(0, c) + y_1 * W(1, c) + y_2 * W(2, c);
        }
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
      Vector3 v(eigen.vectors(0, k), eigen.vectors(1, k), eigen.vectors(2, k));
      v /= std::sqrt(std::sqrt(eigen.values(k)));
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

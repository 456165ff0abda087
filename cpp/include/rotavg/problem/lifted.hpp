#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// 3n x p: one 3 x p block Z_i with orthonormal rows, Z_i Z_i^T = I, for every node.
using LiftedBlocks = Eigen::MatrixXd;

/// What is known at a lifted point.
struct LiftedPoint {
  LiftedBlocks Z;
  double objective = 0.0;
  LiftedBlocks gradient;           ///< Riemannian: 2 S Z
  double relative_gradient = 0.0;  ///< max |gradient_i|_F / deg_i
  std::vector<Matrix3> Lambda;  ///< sym(sum_j E_ij Z_j Z_i^T), one for each node of the component
};

/// What an edge costs at a lifted point, w |E^T Z_a - Z_b|_F^2 with E of length one, a and b the
/// rows of its ends i and j.
inline double lifted_cost(const ResidualQuaternions& residuals, Index edge, const LiftedBlocks& Z,
                          Index a, Index b) {
  const Quaternion e(residuals()[edge]);
  const double w = e.squaredNorm();
  Matrix3 E = weighted_rotation(e);
  E /= w;
  double squares = 0.0;
  for (Eigen::Index c = 0; c < Z.cols(); ++c) {
    const double* const z_a = Z.data() + c * Z.rows() + 3 * a;
    const double* const z_b = Z.data() + c * Z.rows() + 3 * b;
    for (int r = 0; r < 3; ++r) {
      const double d = E(0, r) * z_a[0] + E(1, r) * z_a[1] + E(2, r) * z_a[2] - z_b[r];
      squares += d * d;
    }
  }
  return w * squares;
}

/// The problem (3) on one component with rotations lifted to p dimensions (Burer and Monteiro 2003;
/// Boumal 2015): with p x 3 blocks Y_i instead of R_i, Y_i^T Y_i = I, minimise
///
///     f(Y) = sum w |Y_i R_ij - Y_j|_F^2.
///
/// Y^T Y is feasible for the relaxation (6), so at p = 3n this is the relaxation itself; from some
/// small p on, it has no local minima but the global ones. It is written in the global frame of
/// some rotations R, with Z_i = R_i Y_i^T and E_ij = w R_i R_ij R_j^T, where Z_i = [I 0] stands for
/// R itself. The blocks need not be those of weights: any will do whose objective is const - tr(Z^T
/// E Z).
///
/// @tparam Connection the blocks E_ij at R (problem/connection.hpp)
template <typename Connection>
class LiftedProblemOf {
 public:
  /// @param connection at the rotations R; must, like components, outlive this object
  LiftedProblemOf(const Connection& connection, const Components& components, Index component)
      : connection_(connection),
        components_(components),
        component_(component),
        nodes_(components.nodes[component]) {}

  const Connection& connection() const { return connection_; }
  const Components& components() const { return components_; }
  Index component() const { return component_; }
  const std::vector<Index>& nodes() const { return nodes_; }
  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  double degree(Index a) const { return connection_degree(connection_, nodes_[a]); }

  /// The rotations R, in the dimensions that Z already has.
  LiftedBlocks unlifted() const {
    LiftedBlocks Z = LiftedBlocks::Zero(3 * Eigen::Index{num_nodes()}, 3);
    for (Eigen::Index row = 0; row < Z.rows(); ++row) Z(row, row % 3) = 1.0;
    return Z;
  }

  LiftedPoint evaluate(LiftedBlocks Z) const {
    LiftedPoint at;
    at.gradient = apply_connection(connection_, components_, component_, Z);
    at.Lambda.resize(nodes_.size());
    for (Index a = 0; a < num_nodes(); ++a) {
      at.Lambda[a] = symmetric_part(outer_product(at.gradient, Z, a));  // of E Z
      scale_block(-2.0, at.gradient, a);
      add_block_product(2.0 * at.Lambda[a], Z, a, at.gradient, a);
      const Matrix3 squares = outer_product(at.gradient, at.gradient, a);
      const double norm = std::sqrt(squares(0, 0) + squares(1, 1) + squares(2, 2));
      at.relative_gradient = std::max(at.relative_gradient, norm / degree(a));
    }
    at.objective = objective(Z);
    at.Z = std::move(Z);
    return at;
  }

  double objective(const LiftedBlocks& Z) const {
    return block_sum<double>(num_nodes(), connection_.num_threads(), [&](Index a) {
      double sum = 0.0;
      for (const HalfEdge& h : connection_.graph().row(nodes_[a])) {
        if (!h.is_i()) continue;
        sum += lifted_cost(connection_, h.edge(), Z, a, components_.row_in_component[h.node]);
      }
      return sum;
    });
  }

  /// The Riemannian Hessian along a tangent V: 2 P(S V), S = Lambda - E (Theorem 1) at this point.
  LiftedBlocks hessian(const LiftedPoint& at, const LiftedBlocks& V) const {
    LiftedBlocks H = apply_connection(connection_, components_, component_, V);
    for (Index a = 0; a < num_nodes(); ++a) {
      scale_block(-2.0, H, a);
      add_block_product(2.0 * at.Lambda[a], V, a, H, a);
    }
    project(at.Z, H);
    return H;
  }

  /// V <- P(V), onto the tangent space at Z: V_i - sym(V_i Z_i^T) Z_i.
  void project(const LiftedBlocks& Z, LiftedBlocks& V) const {
    for (Index a = 0; a < num_nodes(); ++a) {
      add_block_product(-symmetric_part(outer_product(V, Z, a)), Z, a, V, a);
    }
  }

  /// Z + V with the rows of every block made orthonormal: Z_i <- L^-1 (Z_i + V_i), where L L^T is
  /// the Gram matrix of the rows; not singular, as it is I + V_i V_i^T for tangents.
  LiftedBlocks retract(const LiftedBlocks& Z, const LiftedBlocks& V) const {
    LiftedBlocks M = Z + V;
    for (Index a = 0; a < num_nodes(); ++a) {
      const Matrix3 gram = outer_product(M, M, a);
      const double l00 = std::sqrt(gram(0, 0)), l10 = gram(1, 0) / l00, l20 = gram(2, 0) / l00;
      const double l11 = std::sqrt(gram(1, 1) - l10 * l10), l21 = (gram(2, 1) - l20 * l10) / l11;
      const double l22 = std::sqrt(gram(2, 2) - (l20 * l20 + l21 * l21));
      for (Eigen::Index c = 0; c < M.cols(); ++c) {
        double* const x = M.data() + c * M.rows() + 3 * a;
        x[0] /= l00;
        x[1] = (x[1] - l10 * x[0]) / l11;
        x[2] = (x[2] - l20 * x[0] - l21 * x[1]) / l22;
      }
    }
    return M;
  }

 private:
  /// A_a <- s A_a.
  static void scale_block(double s, LiftedBlocks& A, Index a) {
    for (Eigen::Index c = 0; c < A.cols(); ++c) {
      for (int r = 0; r < 3; ++r) A(3 * a + r, c) *= s;
    }
  }
  /// A_a B_a^T.
  static Matrix3 outer_product(const LiftedBlocks& A, const LiftedBlocks& B, Index a) {
    Matrix3 sum = Matrix3::Zero();
    for (Eigen::Index c = 0; c < A.cols(); ++c) {
      const double* const x = A.data() + c * A.rows() + 3 * a;
      const double* const y = B.data() + c * B.rows() + 3 * a;
      for (int r = 0; r < 3; ++r) {
        for (int s = 0; s < 3; ++s) sum(r, s) += x[r] * y[s];
      }
    }
    return sum;
  }

  const Connection& connection_;
  const Components& components_;
  Index component_;
  const std::vector<Index>& nodes_;
};
using LiftedProblem = LiftedProblemOf<ResidualQuaternions>;

}  // namespace rotavg

#pragma GCC diagnostic pop

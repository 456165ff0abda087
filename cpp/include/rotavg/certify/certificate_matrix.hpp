#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/problem/sums_at_nodes.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the edges at every node add up to, at some rotations: all that the certificates of the
/// components need besides the residual quaternions themselves.
class NodeSums {
 public:
  /// @param residuals must outlive this object
  explicit NodeSums(const ResidualQuaternions& residuals)
      : residuals_(residuals),
        diagonal_(residuals.graph().nodes().size()),
        gradient_(diagonal_.size()),
        cost_(diagonal_.size()),
        reach_(diagonal_.size()) {
    const auto sums = sums_at_nodes<Sum>(
        graph(), residuals.num_threads(),
        [&](const HalfEdge& h, Sum& sum) {
          sum.add(residuals_()[h.edge()], h.is_i() ? 1.0 : -1.0);
        },
        [&](Index k, Sum& at_i, Sum& at_j) {
          prefetch_ahead(residuals_(), k);
          at_i.add(residuals_()[k], 1.0);
          at_j.add(residuals_()[k], -1.0);
        });
    parallel_for(static_cast<Index>(sums.size()), residuals.num_threads(), [&](Index i) {
      diagonal_[i] = sums[i].diagonal(graph().degree(i));
      gradient_[i] = sums[i].gradient;
      cost_[i] = sums[i].cost();
      reach_[i] = sums[i].reach;
    });
  }

  const MeasurementGraph& graph() const { return residuals_.graph(); }
  const ResidualQuaternions& residuals() const { return residuals_; }
  /// sum_j w sym E_ij = sum_j w I - 2 (|v|^2 I - v v^T)
  const Matrix3& diagonal(Index i) const { return diagonal_[i]; }
  const Vector3& gradient(Index i) const { return gradient_[i]; }
  /// What the edges at a node cost: half of it is its part of f(R).
  double cost(Index i) const { return cost_[i]; }
  /// sum_j |E_ij - w I|_2 = sum_j w 2 sin(angle_ij / 2) = sum_j 2 sqrt(w) |v_ij|
  double reach(Index i) const { return reach_[i]; }

 private:
  /// Of the edges at one node.
  struct Sum {
    /// sum x^2, y^2, z^2, and sum x y, x z, y z: the entries of sum v v^T.
    Vector3 squares = Vector3::Zero(), products = Vector3::Zero();
    Vector3 gradient = Vector3::Zero();
    double reach = 0.0;

    EIGEN_STRONG_INLINE void add(const Vector4& e, double sign) {
      const Vector3 v = vector_part(e), square(v.x() * v.x(), v.y() * v.y(), v.z() * v.z());
      squares += square;
      products += Vector3(v.x() * v.y(), v.x() * v.z(), v.y() * v.z());
      gradient += (sign * 8.0 * e.w()) * v;
      const double of_v = square.x() + square.y() + square.z();
      reach += 2.0 * std::sqrt(of_v * (of_v + e.w() * e.w()));
    }
    Sum& operator+=(const Sum& other) {
      squares += other.squares;
      products += other.products;
      gradient += other.gradient;
      reach += other.reach;
      return *this;
    }
    double cost() const { return 8.0 * (squares.x() + squares.y() + squares.z()); }
    /// sum w sym E_ij of edges of these weights in all.
    Matrix3 diagonal(double degree) const {
      const double xx = squares.x(), yy = squares.y(), zz = squares.z();
      const double xy = 2.0 * products.x(), xz = 2.0 * products.y(), yz = 2.0 * products.z();
      Matrix3 result;
      result << degree - 2.0 * (yy + zz), xy, xz,  //
          xy, degree - 2.0 * (xx + zz), yz,        //
          xz, yz, degree - 2.0 * (xx + yy);
      return result;
    }
  };

  const ResidualQuaternions& residuals_;
  std::vector<Matrix3> diagonal_;
  std::vector<Vector3> gradient_;
  std::vector<double> cost_, reach_;
};

/// S = Lambda - Rt (Theorem 1, (5)) of one connected component, n nodes, with
///
///     Lambda_i = sym( sum_j Rt_ij R_j^T R_i ),
///
/// symmetrised block by block, so that tr(Lambda) = tr(R Rt R^T) at any R, stationary or not; and
/// all of it turned into the global frame, R_i S_ij R_j^T, which changes no eigenvalue. There the
/// blocks are
///
///     S_ij = - sum E_ij,     S_ii = sum sym E_ij,     E_ij = w R_i R_ij R_j^T,
///
/// so that S = L (x) I_3 where all residuals vanish. At a stationary point S N = 0 with N = [I …
/// I]^T; elsewhere S N is the leftover of the gradient.
class CertificateMatrix {
 public:
  /// @param sums, components must outlive this object
  CertificateMatrix(const NodeSums& sums, const Components& components, Index component)
      : sums_(sums),
        components_(components),
        component_(component),
        nodes_(components.nodes[component]) {}

  const MeasurementGraph& graph() const { return sums_.graph(); }
  const ResidualQuaternions& residuals() const { return sums_.residuals(); }
  const Components& components() const { return components_; }
  Index component() const { return component_; }
  const std::vector<Index>& nodes() const { return nodes_; }
  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  Eigen::Index size() const { return 3 * static_cast<Eigen::Index>(num_nodes()); }
  const Matrix3& diagonal(Index a) const { return sums_.diagonal(nodes_[a]); }
  /// sum_j |E_ij - w I|_2
  double reach(Index a) const { return sums_.reach(nodes_[a]); }

  /// S X, without forming S.
  Eigen::MatrixXd apply(const Eigen::MatrixXd& X) const {
    Eigen::MatrixXd Y = apply_connection(residuals(), components_, component_, X);
    parallel_for(num_nodes(), residuals().num_threads(), [&](Index a) {
      Y.middleRows<3>(3 * a) *= -1.0;
      add_block_product(diagonal(a), X, a, Y, a);
    });
    return Y;
  }

  /// (S - kappa L (x) I) X, L the scalar Laplacian.
  Eigen::MatrixXd apply_less_laplacian(const Eigen::MatrixXd& X, double kappa) const {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
    parallel_for(num_nodes(), residuals().num_threads(), [&](Index a) {
      Matrix3 block = diagonal(a);
      add_to_diagonal(block, -kappa * graph().degree(nodes_[a]));
      add_block_product(block, X, a, Y, a);
      for (const HalfEdge& h : graph().row(nodes_[a])) {
        const Quaternion e(residuals()()[h.edge()]);
        block = -weighted_rotation(h.is_i() ? e : e.conjugate());
        add_to_diagonal(block, kappa * e.squaredNorm());
        add_block_product(block, X, components_.row_in_component[h.node], Y, a);
      }
    });
    return Y;
  }

  /// D^-1 X, every node's rows divided by its degree: a preconditioner close to S^-1 on graphs that
  /// are so dense that S cannot be factorised.
  Eigen::MatrixXd divide_by_degree(Eigen::MatrixXd X) const {
    for (Index a = 0; a < num_nodes(); ++a) {
      for (Eigen::Index c = 0; c < X.cols(); ++c) {
        for (int r = 0; r < 3; ++r) X(3 * a + r, c) /= graph().degree(nodes_[a]);
      }
    }
    return X;
  }

  /// N / sqrt(n), 3n x 3, orthonormal: the null vectors of S at a stationary point.
  Eigen::MatrixXd null_vectors() const {
    Eigen::MatrixXd N = Eigen::MatrixXd::Zero(size(), 3);
    const double entry = 1.0 / std::sqrt(double(num_nodes()));
    for (Eigen::Index row = 0; row < size(); ++row) N(row, row % 3) = entry;
    return N;
  }

  /// S N: -skew(sum_j E_ij) = -[g_i / 4] with g the gradient.
  Eigen::MatrixXd leftover() const {
    Eigen::MatrixXd K(size(), 3);
    for (Index a = 0; a < num_nodes(); ++a) {
      const Matrix3 K_a = hat(-0.25 * sums_.gradient(nodes_[a]));
      for (int k = 0; k < 9; ++k) K(3 * a + k % 3, k / 3) = K_a(k);
    }
    return K;
  }

  /// A bound on what rounding in the blocks adds to tr(S Y) for feasible Y (Y >= 0, Y_ii = I). A
  /// residual quaternion carries a relative error of at most 32 u (two products, three conversions
  /// from matrices), its E_ij one of 214 u w in the Frobenius norm; |Y_ij|_F <= sqrt(3), and E_ij
  /// stands in S twice: 742 u w for every edge, half of it at each end. A diagonal block, a sum of
  /// q terms, adds 3 (q + 64) u deg_i.
  double rounding_trace() const {
    double sum = 0.0;
    for (const Index i : nodes_) {
      sum += (3.0 * (graph().row(i).size() + 64.0) + 371.0) * graph().degree(i);
    }
    return unit_roundoff * sum;
  }

  /// How far rounding in the blocks can have moved S - kappa L (x) I, kappa <= 1/2, as a quadratic
  /// form: by at most sum_a block_rounding(a) |x_a|^2.
  ///
  /// The measurements are the rotations of the stored quaternions, the point that of the q_i. Then
  /// e carries an error of 32 u sqrt(w) (two products of 8 u, the lengths of three quaternions), E
  /// one of 64 u w and 9 u w for its entries, its kappa |e|^2 another 37 u w; parallel edges add u
  /// w each. A diagonal block, deg I - kappa deg I - 2 sum (|v|^2 I - v v^T), carries 8 u w of the
  /// errors of |v|, 32 each, and 30 u w of their evaluation for every edge, and 7 q u deg of its q
  /// additions. (|2 x_i . X x_j| <= |X| (|x_i|^2 + |x_j|^2).)
  double block_rounding(Index a) const {
    const Index i = nodes_[a];
    return unit_roundoff * (7.0 * graph().row(i).size() + 400.0) * graph().degree(i);
  }

  /// How far the computed leftover can be from the true one, dK, in two parts. Of the errors of e
  /// every edge adds some d at one end and -d at the other, |hat(d)|_F <= 91 u w: those are
  /// bounded by |d|^2 / w, summed over the edges.
  double leftover_edge_rounding() const {
    double degrees = 0.0;
    for (const Index i : nodes_) degrees += graph().degree(i);
    constexpr double relative = 91.0 * unit_roundoff;
    return relative * relative * 0.5 * degrees;
  }
  /// The other part, of the additions at a node, bounded by |dK_a|_F^2. It is small where the
  /// residuals are: sum_j |s| |v| <= sqrt(deg f_a), and tr(Lambda_a) = 3 deg - 4 f_a with f_a = sum
  /// |v|^2.
  double leftover_node_rounding(Index a) const {
    const Index i = nodes_[a];
    const double degree = graph().degree(i), additions = graph().row(i).size() + 3.0;
    const double squares = std::max(0.25 * (3.0 * degree - diagonal(a).trace()), 0.0);
    const double relative = 2.0 * std::sqrt(2.0) * unit_roundoff * additions;
    return relative * relative * degree * (squares + block_rounding(a));
  }

  double max_degree() const {
    double largest = 0.0;
    for (const Index i : nodes_) largest = std::max(largest, graph().degree(i));
    return largest;
  }

  /// Both parts together, |dK_a|_F^2.
  double leftover_rounding(Index a) const {
    const double edges = 91.0 * unit_roundoff * graph().degree(nodes_[a]);
    return std::pow(edges + std::sqrt(leftover_node_rounding(a)), 2);
  }

  /// S without the nodes that the elimination skips.
  BlockCholesky<3>::Blocks blocks(Elimination& elimination) const {
    return elimination.assemble<3>(
        [this](Index i) -> const Matrix3& { return sums_.diagonal(i); },
        [this](Index k) -> Matrix3 { return -weighted_rotation(Quaternion(residuals()()[k])); });
  }

  /// S - kappa L (x) I - diag(shift) without the nodes that the elimination skips, L the scalar
  /// Laplacian.
  /// @param shift one number for each row of the elimination
  BlockCholesky<3>::Blocks blocks(Elimination& elimination, double kappa,
                                  const std::vector<double>& shift) const {
    return elimination.assemble<3>(
        [&](Index i) -> Matrix3 {
          const Index row = components_.row_in_component[i] - elimination.skipped();
          Matrix3 block = sums_.diagonal(i);
          add_to_diagonal(block, -(kappa * graph().degree(i) + shift[row]));
          return block;
        },
        [&](Index k) -> Matrix3 {
          const Vector4& e = residuals()()[k];
          Matrix3 block = -weighted_rotation(Quaternion(e));
          add_to_diagonal(block, kappa * e.squaredNorm());
          return block;
        });
  }

 private:
  const NodeSums& sums_;
  const Components& components_;
  Index component_;
  const std::vector<Index>& nodes_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

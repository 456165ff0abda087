#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/free_heading.hpp>
#include <rotavg/certify/leftover_solution.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/linalg/multifrontal.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/tall.hpp>
#include <rotavg/problem/connection.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The smallest eigenvalue of S, where S without its first node, S_r, is positive definite.
///
/// @param Z close to S_r^-1 K, zero at the first node
/// @param Q K^T Z: as N^T S N = 0 and S >= -e e^T (x) Q, the eigenvalue lies between -lambda_max(Q)
///        and zero
/// @param cholesky of S_r, or close to it
inline double lambda_min_by_factor(const CertificateMatrix& S, const Eigen::MatrixXd& Z,
                                   const Matrix3& Q, BlockCholesky<3>& cholesky,
                                   const std::function<bool()>& keep_going) {
  const SmallEigen eigen = small_eigen(0.5 * (Q + Q.transpose()));
  const double largest = std::max(eigen.values(2), 0.0);
  if (largest <= 1e-13 * S.max_degree()) return -largest / S.num_nodes();  // to first order
  // Its vector is close to N u - Z u with u the direction in which Q is largest.
  Eigen::MatrixXd start(S.size(), 4);
  start.leftCols<3>() = S.null_vectors();
  start.col(3) = combinations(Z, eigen.vectors.rightCols<1>());
  const LinearOperator inverse = [&](const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
    Y.topRows<3>() = X.topRows<3>() / S.max_degree();
    Y.bottomRows(cholesky.size()) = cholesky.solve(X.bottomRows(cholesky.size()));
    return Y;
  };
  return value_or_nan(min_eigenvalue(S, start, inverse, keep_going));
}

/// The bound from one Cholesky factorisation of S with its first node removed, S_r.
///
/// Split any x as N c + z, with z zero at the first node, and let K = S N be the leftover of the
/// gradient (N^T S N = 0 always). Then x^T S x = 2 c^T K_r^T z + z^T S_r z, and where S_r > 0
///
///     x^T S x >= - c^T Q c,     Q = K_r^T S_r^-1 K_r  (3 x 3),
///
/// so S plus a block that is similar to Q on the diagonal at the first node is positive
/// semidefinite, and by duality, as Y_ii = I in (6), f(R) - f* <= tr Q. At a stationary point Q = 0
/// and this is Theorem 1; near one, tr Q is what a Newton step would still gain.
///
/// Rounding spoils neither. What is factorised is S_r - kappa L_r (x) I - diag(D + mu), with D what
/// rounding in the blocks and in the factorisation can amount to; so success proves
///
///     S_r >= kappa L_r (x) I + diag(mu)
///
/// outright, L_r being the scalar Laplacian. And with K = K~ + dK, dK the rounding of the gradient,
/// and rho = K~ - (S_r - kappa L_r) Z for any Z, as S_r - kappa L_r is at least diag(mu),
///
///     tr Q <= ( sqrt( tr(Z^T K~) + tr(Z^T rho) + sum |rho_a|^2 / mu_a )
///               + sqrt( sum_edges |dK_ij|^2 / (kappa w_ij) ) + sqrt( sum |dK_a|^2 / mu_a ) )^2,
///
/// as the edges' part of dK is B^T d with B the incidence matrix, L = B^T W B, and d^T B L^-1 B^T d
/// <= d^T W^-1 d. All of it is of second order: the square of the residual, or of the rounding.
///
/// A large factor is not kept (but with free headings), for that it exists is all that is asked of
/// it: Z need not be exact, and comes from conjugate gradients (leftover_solution.hpp).
class DefiniteFactorization {
 public:
  /// A factor of more bytes is not kept, but with free headings.
  static constexpr double large_factor = 1e8;

  /// @param S, elimination (of the component, without its root) must outlive this object
  /// @param resolution how small a gap has to be told from zero: kappa is no larger than needed
  /// @param noise the objective over the sum of weights
  DefiniteFactorization(const CertificateMatrix& S, Elimination& elimination, double resolution,
                        double noise, const GravityPairs& gravity = {},
                        double most_kept_bytes = large_factor)
      : S_(S),
        elimination_(elimination),
        resolution_(resolution),
        headings_(free_headings(S, gravity)) {
    if (!headings_.empty() || elimination.factor_bytes(3) <= most_kept_bytes) make_factor();
    constexpr double part = 0.01, low_noise = 1e-4;
    const double wanted = S.leftover_edge_rounding() / (part * resolution);
    kappa_ = std::clamp(wanted, 1e-12, noise < low_noise ? 0.5 : 1e-3);
    const std::vector<double> rounding = cholesky_rounding(*elimination.symbolic(), 3);
    mu_.reserve(rounding.size());
    for (Index a = 0; a < elimination.size(); ++a) {
      // No diagonal entry exceeds the degree. (Gravity's two edges are meant to be half a turn
      // apart, and are so to rounding.)
      const double blocks = (headings_.empty() ? 1.0 : 2.0) * S.block_rounding(a + 1);
      mu_.push_back(rounding[a] * S.graph().degree(elimination.node(a)) + blocks);
    }
    if (!headings_.empty()) add_to_mu(heading_mu);
    for (const FreeHeading& heading : headings_) {
      std::vector<bool> in_part;
      for (const Index i : S.nodes()) {
        in_part.push_back(gravity.free_heading[i] == heading.label);
      }
      in_part_.push_back(std::move(in_part));
      mu_[heading.row - 1] += rounding[heading.row - 1] * S.graph().degree(S.nodes()[heading.row]);
    }
  }

  /// Room for a factor of S_r or what is close to it.
  /// @throws std::bad_alloc where memory for it is not free
  BlockCholesky<3>& cholesky() {
    if (!cholesky_) make_factor();
    return *cholesky_;
  }

  CholeskyOutcome factorize(const std::function<bool()>& keep_going) {
    constexpr double modest = 1e-6;
    const auto outcome = factorize_once(keep_going);
    const bool less_may_do = kappa_ > modest || !headings_.empty();
    if (outcome != CholeskyOutcome::not_positive_definite || !less_may_do) return outcome;
    kappa_ = std::min(kappa_, modest);  // too much was asked for, perhaps
    if (!headings_.empty()) add_to_mu(-heading_mu);
    return factorize_once(keep_going);
  }

  /// After a factorisation that ran to its end. With free headings (free_heading.hpp) there are
  /// further columns of K, for d; over the feasible set |d|^2 is at most four times |c|^2.
  ComponentBound bound(const std::function<bool()>& keep_going) {
    const Eigen::MatrixXd K = leftover();
    Eigen::MatrixXd Z;
    if (cholesky_) {
      Z.setZero(K.rows(), K.cols());
      Z.bottomRows(K.rows() - 3) = cholesky_->solve(K.bottomRows(K.rows() - 3));
    } else {
      try {
        Z = LeftoverSolution(S_, elimination_, kappa_, mu_)(K, resolution_, keep_going);
      } catch (const std::bad_alloc&) {
        Z.setZero(K.rows(), K.cols());  // it is a proof all the same
      }
    }
    Eigen::MatrixXd rho = K - S_.apply_less_laplacian(Z, kappa_);
    for (const FreeHeading& heading : headings_) {
      add_block_product(-added(heading), Z, heading.row, rho, heading.row);
    }
    double node_square = 0.0, heading_square = 0.0;  // of the rounding of K
    for (Index a = 1; a < S_.num_nodes(); ++a) {
      node_square += S_.leftover_node_rounding(a) / mu_[a - 1];
      heading_square += std::pow(4.0 * S_.block_rounding(a), 2) / mu_[a - 1];
    }
    const Eigen::Index others = K.cols() - 3;
    double root = std::sqrt(square(K.leftCols(3), Z.leftCols(3), rho.leftCols(3))) +
                  std::sqrt(S_.leftover_edge_rounding() / kappa_) + std::sqrt(node_square);
    if (others > 0) {
      root +=
          2.0 * std::sqrt(square(K.rightCols(others), Z.rightCols(others), rho.rightCols(others))) +
          3.0 * std::sqrt(heading_square);
    }
    constexpr double margin = 1.0 + 1e-9;  // for the rounding of these sums
    ComponentBound bound;
    bound.method = CertificateMethod::factorization;
    bound.is_definite = true;
    bound.gap = margin * root * root;
    if (cholesky_) {
      const Matrix3 Q = inner_products(K.leftCols(3), Z.leftCols(3));
      bound.lambda_min = lambda_min_by_factor(S_, Z.leftCols(3), Q, *cholesky_, keep_going);
    } else if (bound.gap <= resolution_) {
      bound.lambda_min = -bound.gap / S_.num_nodes();  // not above it, to first order
    }
    return bound;
  }

 private:
  void make_factor() {
    const double bytes = elimination_.factor_bytes(3);
    if (bytes > large_factor && !has_memory_for(bytes)) throw std::bad_alloc();
    cholesky_.emplace(elimination_.symbolic(), elimination_.num_threads());
  }

  CholeskyOutcome factorize_once(const std::function<bool()>& keep_going) {
    if (cholesky_) return cholesky_->factorize(blocks(), 0.0, keep_going);
    return definiteness<3>(elimination_.symbolic(), blocks(), elimination_.num_threads(),
                           keep_going);
  }

  /// Of the degrees: with free headings the rounding of K has no pairs that a large kappa bounds.
  static constexpr double heading_mu = 1e-6;

  void add_to_mu(double share) {
    for (Index a = 0; a < elimination_.size(); ++a) {
      mu_[a] += share * S_.graph().degree(elimination_.node(a));
    }
  }

  BlockCholesky<3>::Blocks blocks() {
    std::vector<double> shift(mu_);
    for (double& entry : shift) entry *= 2.0;  // D and mu
    BlockCholesky<3>::Blocks blocks = S_.blocks(elimination_, kappa_, shift);
    for (const FreeHeading& heading : headings_) {
      blocks[elimination_.pattern().start[heading.row - 1]] += added(heading);
    }
    return blocks;
  }

  /// What stands at the node of a free heading besides.
  Matrix3 added(const FreeHeading& heading) const {
    return S_.graph().degree(S_.nodes()[heading.row]) * heading.P - heading.B;
  }

  /// S [N N'], but for what is added to S at the world, whose rows do not count.
  Eigen::MatrixXd leftover() const {
    const auto size = static_cast<Eigen::Index>(headings_.size());
    Eigen::MatrixXd K(S_.size(), 3 + 2 * size);
    K.leftCols(3) = S_.leftover();
    for (Eigen::Index h = 0; h < size; ++h) {
      const FreeHeading& heading = headings_[h];
      const Matrix3 less = -heading.B;
      for (int k = 0; k < 9; ++k) K(3 * heading.row + k % 3, k / 3) += less(k);
      Eigen::MatrixXd turn = Eigen::MatrixXd::Zero(S_.size(), 2);
      for (Index a = 1; a < S_.num_nodes(); ++a) {
        if (!in_part_[h][a]) continue;
        for (int k = 0; k < 6; ++k) turn(3 * a + k % 3, k / 3) = heading.across(k);
      }
      Eigen::MatrixXd turned = S_.apply(turn);
      add_block_product(less, turn, heading.row, turned, heading.row);
      K.middleCols(3 + 2 * h, 2) = turned;
    }
    return K;
  }

  /// tr(A_a^T B_a), of blocks of three rows.
  static double block_dot(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, Index a) {
    double sum = 0.0;
    for (Eigen::Index c = 0; c < A.cols(); ++c) {
      for (int r = 0; r < 3; ++r) sum += A(3 * a + r, c) * B(3 * a + r, c);
    }
    return sum;
  }

  /// A bound on tr(K^T S_r^-1 K) by Z and its residual.
  double square(const Eigen::MatrixXd& K, const Eigen::MatrixXd& Z,
                const Eigen::MatrixXd& rho) const {
    double longest = 0.0;  // of the blocks of Z
    for (Index a = 1; a < S_.num_nodes(); ++a) {
      longest = std::max(longest, std::sqrt(block_dot(Z, Z, a)));
    }
    const double summing = unit_roundoff * static_cast<double>(S_.size());
    double first_order = 0.0, rho_square = 0.0, error_square = 0.0;
    for (Index a = 1; a < S_.num_nodes(); ++a) {
      const double K_norm = std::sqrt(block_dot(K, K, a)), rho_a = block_dot(rho, rho, a);
      // Of rho: the blocks' rounding and as much again for the products.
      const double error = 4.0 * S_.block_rounding(a) * longest + 4.0 * unit_roundoff * K_norm;
      first_order += block_dot(K, Z, a) + block_dot(rho, Z, a);
      first_order += longest * error + summing * longest * (K_norm + std::sqrt(rho_a));
      rho_square += rho_a / mu_[a - 1];
      error_square += error * error / mu_[a - 1];
    }
    const double rest = std::sqrt(rho_square) + std::sqrt(error_square);
    return std::max(first_order, 0.0) + rest * rest;
  }

  const CertificateMatrix& S_;
  Elimination& elimination_;
  std::optional<BlockCholesky<3>> cholesky_;
  double resolution_, kappa_ = 0.0;
  std::vector<double> mu_;  ///< of every row of the elimination; D is the same
  std::vector<FreeHeading> headings_;
  std::vector<std::vector<bool>> in_part_;  ///< of every heading, by row of the component
};

/// The same where S_r is so nearly singular that the shift makes it indefinite: rounding goes into
/// the gap. The factor is that of S_r + E with |z^T E z| <= z^T D z for a diagonal D; over the
/// feasible set each block of z, x_i - R_i^T c, is at most twice as long as x_i, whose square is
/// one: that makes 4 tr D.
///
/// @param cholesky of S_r, factorised and positive definite
inline ComponentBound bound_by_grounded_factorization(const CertificateMatrix& S,
                                                      BlockCholesky<3>& cholesky,
                                                      const std::function<bool()>& keep_going) {
  const Eigen::MatrixXd K = S.leftover();
  const Eigen::Index rows = cholesky.size();
  ComponentBound bound;
  Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(S.size(), 3);
  Z.bottomRows(rows) = cholesky.solve(K.bottomRows(rows));
  const Matrix3 Q = inner_products(K, Z);
  bound.gap = std::max(Q.trace(), 0.0) + 4.0 * cholesky.rounding_trace() + S.rounding_trace();
  bound.method = CertificateMethod::factorization;
  bound.is_definite = true;
  bound.lambda_min = lambda_min_by_factor(S, Z, Q, cholesky, keep_going);
  return bound;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/certify/bound.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/tall.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The bound f(R) - f* <= tr(K^T S_r^-1 K) from one factorisation of S without its first node, S_r,
/// with K = S N the leftover of the gradient: as DefiniteFactorization (certify/factorization.hpp).
///
/// Rounding does not spoil it. What is factorised is S_r - diag(D + mu), with D what rounding in
/// the blocks and in the factorisation can amount to; success proves S_r >= diag(mu). With K = K~ +
/// dK and rho = K~ - S_r Z for any Z,
///
///     gap <= ( sqrt( tr(Z^T K~) + tr(Z^T rho) + sum |rho_a|^2 / mu_a ) + sqrt( sum |dK_a|^2 / mu_a
///            ) )^2.
///
/// Given S - kappa L_W instead (less_firm_edges), that is what is factorised, and the errors of
/// those edges count by themselves.
///
/// @param S must be of the component of `elimination`, which is without its root
/// @param largest_mu of the scale of a node: the larger mu may be, the less rounding counts
/// @returns CertificateMethod::none where S_r is not positive definite, or the work was stopped
inline ComponentBound bound_by_grounded_factorization(const AnisotropicCertificateMatrix& S,
                                                      Elimination& elimination, double largest_mu,
                                                      const std::function<bool()>& keep_going) {
  ComponentBound bound;
  BlockCholesky<3> cholesky(elimination.symbolic(), elimination.num_threads());
  const std::vector<double> rounding = cholesky_rounding(*elimination.symbolic(), 3);
  std::vector<double> mu(static_cast<std::size_t>(S.num_nodes()), 0.0), shift(mu);
  auto outcome = CholeskyOutcome::not_positive_definite;
  for (const double share : {largest_mu, 1e-3 * largest_mu, 0.0}) {
    for (Index a = 1; a < S.num_nodes(); ++a) {
      const double D = 1.01 * rounding[a - 1] * S.scale(a) + S.block_rounding(a);
      mu[a] = D + share * S.scale(a);
      shift[a] = -(D + mu[a]);
    }
    outcome = cholesky.factorize(S.blocks(elimination, shift), 0.0, keep_going);
    if (outcome != CholeskyOutcome::not_positive_definite) break;
  }
  if (outcome != CholeskyOutcome::positive_definite) return bound;

  const Eigen::MatrixXd K = S.leftover();
  Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(K.rows(), K.cols());
  Z.bottomRows(cholesky.size()) = cholesky.solve(K.bottomRows(cholesky.size()));
  const Eigen::MatrixXd rho = K - S.apply(Z);
  double longest = 0.0;  // of the blocks of Z
  for (Index a = 1; a < S.num_nodes(); ++a) {
    longest = std::max(longest, Z.middleRows<3>(3 * a).norm());
  }
  const double summing = unit_roundoff * static_cast<double>(S.size());
  double first_order = 0.0, rho_square = 0.0, error_square = 0.0, leftover_square = 0.0;
  for (Index a = 1; a < S.num_nodes(); ++a) {
    const auto K_a = K.middleRows<3>(3 * a), rho_a = rho.middleRows<3>(3 * a);
    const double error = 4.0 * S.block_rounding(a) * longest + 4.0 * unit_roundoff * K_a.norm();
    first_order += K_a.cwiseProduct(Z.middleRows<3>(3 * a)).sum();
    first_order += longest * (rho_a.norm() + error) + summing * longest * K_a.norm();
    rho_square += rho_a.squaredNorm() / mu[a];
    error_square += error * error / mu[a];
    leftover_square += std::pow(S.leftover_rounding(a), 2) / mu[a];
  }
  const double rest = std::sqrt(rho_square) + std::sqrt(error_square);
  const double root = std::sqrt(std::max(first_order, 0.0) + rest * rest) +
                      std::sqrt(leftover_square) + std::sqrt(S.leftover_edge_rounding());
  bound.method = CertificateMethod::factorization;
  bound.is_definite = true;
  bound.gap = (1.0 + 1e-9) * root * root;
  bound.rounding = leftover_square + S.leftover_edge_rounding();
  // As N^T S N = 0 and S >= -e e^T (x) Q, Q = K^T Z, to first order:
  const Eigen::MatrixXd Q = inner_products(K, Z);
  bound.lambda_min =
      -std::max(small_eigen(0.5 * (Q + Q.transpose())).values(2), 0.0) / S.num_nodes();
  return bound;
}

/// The bound where S is not positive semidefinite, for any shift with S + shift diag(scale) >= 0,
/// which a factorisation of all of S proves: f(R) - f* <= 3 shift sum of scale.
///
/// @param elimination of all nodes
/// @param start where the shift begins, near what it has to be
inline ComponentBound bound_by_shifted_factorization(const AnisotropicCertificateMatrix& S,
                                                     Elimination& elimination, double start,
                                                     const std::function<bool()>& keep_going) {
  constexpr double growth = 1.5, most = 8.0;
  ComponentBound bound;
  BlockCholesky<3> cholesky(elimination.symbolic(), elimination.num_threads());
  const std::vector<double> rounding = cholesky_rounding(*elimination.symbolic(), 3);
  std::vector<double> diagonal(static_cast<std::size_t>(S.num_nodes()));
  double scales = 0.0;
  for (Index a = 0; a < S.num_nodes(); ++a) scales += S.scale(a);
  // |S| <= 2 scale, so this ends.
  for (double shift = std::max(start, 1e-12); shift <= most; shift *= growth) {
    for (Index a = 0; a < S.num_nodes(); ++a) {
      const double entry = (1.0 + shift) * S.scale(a);
      diagonal[a] = shift * S.scale(a) - 1.01 * rounding[a] * entry - S.block_rounding(a);
    }
    const auto outcome = cholesky.factorize(S.blocks(elimination, diagonal), 0.0, keep_going);
    if (outcome == CholeskyOutcome::stopped) break;
    if (outcome == CholeskyOutcome::not_positive_definite) continue;
    bound.method = CertificateMethod::factorization;
    bound.gap = 3.0 * shift * scales * (1.0 + 1e-9);
    break;
  }
  return bound;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

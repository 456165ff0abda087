#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/tall.hpp>

namespace rotavg {

/// The bound from one Cholesky factorisation of S with its first node removed, S_r.
///
/// Split any x as R^T c + z, with z zero at the first node, and let K = S R^T be the leftover of
/// the gradient (R S R^T = 0 always). Then x^T S x = 2 c^T K_r^T z + z^T S_r z, and where S_r > 0
///
///     x^T S x >= - c^T Q c,     Q = K_r^T S_r^-1 K_r  (3 x 3),
///
/// so S plus a block that is similar to Q on the diagonal at the first node is positive
/// semidefinite, and by duality, as Y_ii = I in (6), f(R) - f* <= tr Q. At a stationary point Q = 0
/// and this is Theorem 1; near one, tr Q is what a Newton step would still gain.
///
/// Rounding goes into the gap. The factor is that of S_r + E with |z^T E z| <= z^T D z for a
/// diagonal D; over the feasible set each block of z, x_i - R_i^T c, is at most twice as long as
/// x_i, whose square is one: that makes 4 tr D.
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

  // u^T N^T S N u = 0 and S >= -e e^T (x) Q: lambda_min lies between -lambda_max(Q) and zero.
  const SmallEigen eigen = small_eigen(0.5 * (Q + Q.transpose()));
  const double largest = std::max(eigen.values(2), 0.0);
  if (largest <= 1e-13 * S.max_degree()) {
    bound.lambda_min = -largest / S.num_nodes();  // to first order
    return bound;
  }
  // Its vector is close to N u - Z u with u the direction in which Q is largest.
  Eigen::MatrixXd start(S.size(), 4);
  start.leftCols<3>() = S.null_vectors();
  start.col(3) = combinations(Z, eigen.vectors.rightCols<1>());
  const LinearOperator inverse = [&](const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
    Y.topRows<3>() = X.topRows<3>() / S.max_degree();
    Y.bottomRows(rows) = cholesky.solve(X.bottomRows(rows));
    return Y;
  };
  bound.lambda_min = value_or_nan(min_eigenvalue(S, start, inverse, keep_going));
  return bound;
}

/// The bound where S is not positive semidefinite: f(R) - f* <= 3 n shift for any shift with
/// S + shift I > 0, which a factorisation of the whole of S proves. The shift starts near an
/// estimate of -lambda_min, grows until the factorisation succeeds, and is then drawn down to the
/// eigenvalue that the factor gives; where that fails, it was not the smallest, which is unknown.
///
/// @param elimination of all nodes
inline ComponentBound bound_by_shifted_factorization(const CertificateMatrix& S,
                                                     Elimination& elimination,
                                                     const std::function<bool()>& keep_going) {
  ComponentBound bound;
  const BlockCholesky<3>::Blocks blocks = S.blocks(elimination);
  BlockCholesky<3> cholesky(elimination.symbolic());
  const double scale = S.max_degree();
  const double smallest_shift = 1e-13 * scale, rounding = 1e-10 * scale;
  constexpr int rough_iterations = 30;
  const double rough = min_eigenvalue_on_complement(S, keep_going, 1e-3, rough_iterations).value;

  const auto factorize = [&](double shift) {
    const CholeskyOutcome outcome = cholesky.factorize(blocks, shift, keep_going);
    if (outcome == CholeskyOutcome::positive_definite) {
      const double gap =
          shift * static_cast<double>(S.size()) + cholesky.rounding_trace() + S.rounding_trace();
      bound.gap = std::min(bound.gap, gap);
      bound.method = CertificateMethod::factorization;
    }
    return outcome;
  };
  // S + 2 max_degree I > 0 always (Gershgorin), so this ends.
  double shift = std::max(smallest_shift, -1.5 * rough);
  CholeskyOutcome outcome = factorize(shift);
  while (outcome == CholeskyOutcome::not_positive_definite && shift <= 4.0 * scale) {
    shift *= 4.0;
    outcome = factorize(shift);
  }
  if (outcome != CholeskyOutcome::positive_definite) return bound;
  const LinearOperator inverse = [&](const Eigen::MatrixXd& X) { return cholesky.solve(X); };
  const Eigen::Index block = std::min<Eigen::Index>(4, S.size());
  const Eigenpair smallest = min_eigenvalue(S, random_start(S.size(), block), inverse, keep_going);
  if (!smallest.converged) return bound;

  bound.lambda_min = smallest.value;
  const double tight = std::max(0.0, -smallest.value * (1.0 + 1e-6)) + smallest_shift;
  if (tight < shift && factorize(tight) == CholeskyOutcome::not_positive_definite &&
      tight + rounding < shift &&
      factorize(tight + rounding) == CholeskyOutcome::not_positive_definite) {
    bound.lambda_min = std::numeric_limits<double>::quiet_NaN();
  }
  return bound;
}

/// The bound where S need not be positive definite without its first node: by a shifted
/// factorisation, or, where that would take more than `max_flops`, an estimate.
inline ComponentBound bound_certificate_matrix(const CertificateMatrix& S, double max_flops,
                                               const std::function<bool()>& keep_going) {
  Elimination whole(S.graph(), S.components(), S.component(), /*skipped=*/0);
  if (whole.flops(3, max_flops) > max_flops) return bound_by_eigenvalue(S, keep_going);
  return bound_by_shifted_factorization(S, whole, keep_going);
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <functional>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/linalg/cholesky.hpp>

namespace rotavg {

/// What is known of one component: f(R) - f* <= gap, and the smallest eigenvalue of S.
struct ComponentBound {
  bool rigorous = false;  ///< gap holds by a proof, not by an estimate
  bool finished = false;  ///< false if the caller stopped the work: then gap is only f(R) itself
  double gap = 0.0;
  double lambda_min = 0.0;
};

/// The bound from one Cholesky factorisation of S with its first node removed, S_r.
///
/// Split any x as R^T c + z, with z zero at the first node, and let K = S R^T be the leftover of
/// the gradient (R S R^T = 0 always). Then x^T S x = 2 c^T K_r^T z + z^T S_r z, and where S_r > 0
///
///     x^T S x >= - c^T Q c,     Q = K_r^T S_r^-1 K_r  (3 x 3),
///
/// so S plus a block that is similar to Q on the diagonal at the first node is positive
/// semidefinite, and by duality, as Y_ii = I in (6), f(R) - f* <= tr Q. At a stationary point Q = 0
/// and this is Theorem 1; near one, tr Q is what a Newton step would still gain. What rounding can
/// add, in S and in its factor, is bounded and goes into the gap.
///
/// Writes `bound` and returns true if S_r > 0.
inline bool bound_by_grounded_factorization(const CertificateMatrix& S, SparseCholesky& cholesky,
                                            const SparseSymmetric& grounded,
                                            const std::function<bool()>& keep_going,
                                            ComponentBound& bound) {
  const auto outcome = cholesky.factorize(grounded, 0.0, keep_going);
  if (outcome != SparseCholesky::Outcome::positive_definite) {
    bound.finished = outcome != SparseCholesky::Outcome::stopped;
    return false;
  }
  const Eigen::MatrixXd K = S.leftover();
  const Eigen::Index rows = grounded.rows();
  const double trace_Q = K.bottomRows(rows).cwiseProduct(cholesky.solve(K.bottomRows(rows))).sum();
  bound.gap = trace_Q + cholesky.rounding_trace() + S.rounding_trace();
  bound.rigorous = true;

  const LinearOperator inverse = [&](const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
    Y.bottomRows(rows) = cholesky.solve(X.bottomRows(rows));
    return Y;
  };
  // S >= 0 but for the leftover, so the smallest eigenvalue lies by the null vectors.
  bound.lambda_min = min_eigenvalue(S, orthonormal_null_vectors(S), inverse, keep_going).value;
  bound.finished = true;
  return true;
}

/// The bound where S is not positive semidefinite: f(R) - f* <= 3 n shift for any shift with
/// S + shift I > 0, which a factorisation of the whole of S proves. The shift starts near an
/// estimate of -lambda_min, grows until the factorisation succeeds, and is then drawn down to the
/// eigenvalue that the factor gives.
inline ComponentBound bound_by_shifted_factorization(const CertificateMatrix& S,
                                                     const std::function<bool()>& keep_going) {
  using Outcome = SparseCholesky::Outcome;
  ComponentBound bound;
  const SparseSymmetric lower = S.lower(0);
  SparseCholesky cholesky(lower);
  const double scale = S.max_degree();
  const double smallest_shift = 1e-13 * scale;
  constexpr int rough_iterations = 30;
  const double rough = min_eigenvalue_on_complement(S, keep_going, 1e-3, rough_iterations).value;

  const auto gap_at = [&](double shift) {
    return shift * static_cast<double>(S.size()) + cholesky.rounding_trace() + S.rounding_trace();
  };
  double shift = std::max(-1.5 * rough, smallest_shift);
  Outcome outcome = Outcome::not_run;
  for (; outcome != Outcome::positive_definite; shift *= 4.0) {
    outcome = cholesky.factorize(lower, shift, keep_going);
    if (outcome == Outcome::stopped) return bound;
    if (outcome == Outcome::positive_definite) break;
  }
  bound.gap = gap_at(shift);
  bound.rigorous = true;
  const LinearOperator inverse = [&](const Eigen::MatrixXd& X) { return cholesky.solve(X); };
  const Eigen::Index block = std::min<Eigen::Index>(4, S.size());
  bound.lambda_min = min_eigenvalue(S, random_start(S.size(), block), inverse, keep_going).value;

  const double tight = std::max(-bound.lambda_min * (1.0 + 1e-6), 0.0) + smallest_shift;
  if (tight < shift && cholesky.factorize(lower, tight, keep_going) == Outcome::positive_definite) {
    bound.gap = std::min(bound.gap, gap_at(tight));
  }
  bound.finished = true;
  return bound;
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <functional>
#include <limits>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>

namespace rotavg {

/// The bound where S is not positive semidefinite: f(R) - f* <= 3 n shift for any shift with
/// S + shift I > 0, which a factorisation of the whole of S proves. The shift starts near an
/// estimate of -lambda_min, grows until the factorisation succeeds, and is then drawn down to the
/// eigenvalue that the factor gives; where that fails, it was not the smallest, which is unknown.
///
/// @param elimination of all nodes
template <typename Matrix>
ComponentBound bound_by_shifted_factorization(const Matrix& S, Elimination& elimination,
                                              const std::function<bool()>& keep_going) {
  ComponentBound bound;
  const BlockCholesky<3>::Blocks blocks = S.blocks(elimination);
  BlockCholesky<3> cholesky(elimination.symbolic(), elimination.num_threads());
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
///
/// @tparam Matrix CertificateMatrix, or LiftedCertificateMatrix
template <typename Matrix>
ComponentBound bound_certificate_matrix(const Matrix& S, double max_flops,
                                        const std::function<bool()>& keep_going,
                                        int num_threads = 1) {
  Elimination whole(S.graph(), S.components(), S.component(), /*skipped=*/0, num_threads);
  if (whole.flops(3, max_flops) > max_flops) return bound_by_eigenvalue(S, keep_going);
  return bound_by_shifted_factorization(S, whole, keep_going);
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/lobpcg.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/connection.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A lower estimate of lambda_min(Rt), Algorithm 3's choice of mu: the Rayleigh quotient less its
/// residual, to `relative_tolerance` of the largest degree.
inline double min_eigenvalue_of_measurements(const MeasurementGraph& graph, int num_threads,
                                             const std::function<bool()>& keep_going = {},
                                             double relative_tolerance = 1e-4) {
  const Eigen::Index rows = 3 * static_cast<Eigen::Index>(graph.num_nodes());
  const LinearOperator apply = [&](const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(rows, X.cols());
    parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
      for (const HalfEdge& h : graph.row(i)) add_block_product(graph.block(h), X, h.node, Y, i);
    });
    return Y;
  };
  double max_degree = 0.0;
  for (Index i = 0; i < graph.num_nodes(); ++i) max_degree = std::max(max_degree, graph.degree(i));

  LobpcgOptions options;
  options.tolerance = relative_tolerance * max_degree;
  options.keep_going = keep_going;
  const Eigenpair pair =
      smallest_eigenpair(apply, {}, random_start(rows, 4), Eigen::MatrixXd(rows, 0), options);
  // Gershgorin: the spectrum of Rt lies within [-max_degree, max_degree].
  return std::max(pair.value - pair.residual, -max_degree);
}

inline double value_or_nan(const Eigenpair& pair) {
  return pair.converged ? pair.value : std::numeric_limits<double>::quiet_NaN();
}

/// The smallest eigenpair of S, given a start and a preconditioner close to the inverse of S (or of
/// S + shift).
/// @tparam Matrix CertificateMatrix, or LiftedCertificateMatrix
template <typename Matrix>
Eigenpair min_eigenvalue(const Matrix& S, const Eigen::MatrixXd& start,
                         const LinearOperator& preconditioner,
                         const std::function<bool()>& keep_going) {
  LobpcgOptions options;
  options.tolerance = 1e-12 * S.max_degree();
  options.value_tolerance = 1e-14 * S.max_degree();
  options.max_iterations = 300;
  options.keep_going = keep_going;
  return smallest_eigenpair([&](const Eigen::MatrixXd& X) { return S.apply(X); }, preconditioner,
                            start, Eigen::MatrixXd(S.size(), 0), options);
}

/// The smallest eigenpair of S on the complement of the null vectors R^T, to `relative_tolerance`
/// of itself: positive at a strict optimum, negative where S refutes R. No factorisation: only the
/// degrees are a preconditioner.
/// @param near a vector to start from, beside a random one
template <typename Matrix>
Eigenpair min_eigenvalue_on_complement(const Matrix& S, const std::function<bool()>& keep_going,
                                       double relative_tolerance, int max_iterations,
                                       const Eigen::MatrixXd& near = {}) {
  LobpcgOptions options;
  options.tolerance = 0.0;
  options.relative_tolerance = relative_tolerance;
  options.min_iterations = 20;
  options.max_iterations = max_iterations;
  options.keep_going = keep_going;
  Eigen::MatrixXd start = random_start(S.size(), std::min<Eigen::Index>(2, S.size() - 3));
  if (near.size() > 0) start.leftCols(1) = near.leftCols(1);
  return smallest_eigenpair([&](const Eigen::MatrixXd& X) { return S.apply(X); },
                            [&](const Eigen::MatrixXd& X) { return S.divide_by_degree(X); }, start,
                            S.null_vectors(), options);
}

/// lambda_min(S) where S is positive on the complement of its null vectors: their part of the
/// leftover K = S N makes it less than zero by little.
/// @param lowest what it is not below
template <typename Matrix>
double lambda_min_near_null_vectors(const Matrix& S, const Eigen::MatrixXd& K, double lowest,
                                    const std::function<bool()>& keep_going) {
  if (lowest >= -1e-13 * S.max_degree()) return lowest;
  Eigen::MatrixXd start(S.size(), 2 * K.cols());
  start.leftCols(K.cols()) = S.null_vectors();
  start.rightCols(K.cols()) = S.divide_by_degree(K);
  return value_or_nan(min_eigenvalue(
      S, start, [&](const Eigen::MatrixXd& X) { return S.divide_by_degree(X); }, keep_going));
}

/// An estimate of the bound where nothing can be factorised, whatever S is: S is at least theta on
/// the complement of its null vectors N / sqrt(n), if LOBPCG met the smallest eigenvalue there, and
/// |S N| / sqrt(n) = epsilon couples the two, so lambda_min(S) is at least the smallest eigenvalue
/// of [0, epsilon; epsilon, theta].
///
/// @param near a vector to start from, beside a random one
template <typename Matrix>
ComponentBound bound_by_eigenvalue(const Matrix& S, const std::function<bool()>& keep_going,
                                   int max_iterations = 1000, const Eigen::MatrixXd& near = {}) {
  const Eigenpair pair = min_eigenvalue_on_complement(S, keep_going, 0.1, max_iterations, near);
  const double theta = pair.value - pair.residual;
  const Eigen::MatrixXd K = S.leftover();
  const double epsilon = K.norm() / std::sqrt(static_cast<double>(S.num_nodes()));
  const double below_zero = 0.5 * (std::hypot(theta, 2.0 * epsilon) - theta);
  ComponentBound bound;
  if (!pair.converged) {  // a negative Rayleigh quotient refutes R all the same
    if (pair.value < 0.0) bound.lambda_min = pair.value;
    return bound;
  }
  bound.method = CertificateMethod::eigenvalue;
  bound.gap = below_zero * static_cast<double>(S.size()) + S.rounding_trace();
  bound.is_definite = theta > 0.0;
  bound.lambda_min =
      pair.value < 0.0 ? pair.value : lambda_min_near_null_vectors(S, K, -below_zero, keep_going);
  return bound;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

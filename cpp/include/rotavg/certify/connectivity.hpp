#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/linalg/buffer.hpp>
#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Operations that bound_by_connectivity takes.
inline double connectivity_flops(const CertificateMatrix& S) {
  const double n = S.num_nodes();
  return n * n * n / 3.0;
}

/// A proof at 1/27 of the cost of factorising S, for well connected graphs: that the algebraic
/// connectivity exceeds what the residuals can take away.
///
/// In the global frame S = L (x) I_3 + N, with N_ij = -(E_ij - w I) and N_ii = sum (sym E_ij - w
/// I). By blocks, N >= -diag(d_i + r_i) (x) I_3 with
///
///     d_i = |N_ii|_2,     r_i = sum_j |N_ij|_2 = sum_j w 2 sin(angle_ij / 2) = sum_j 2 sqrt(w)
///     |v_ij|
///
/// (Gershgorin, for blocks). One dense n x n Cholesky factorisation of
///
///     L - diag(d + r) + c 1 1^T - l I > 0
///
/// proves z^T S z >= l |z|^2 for all z orthogonal to the null vectors N = [I … I]^T, where the term
/// with c vanishes. Split any x as N c + z: with the leftover K = S N, x^T S x >= 2 c^T K^T z + l
/// |z|^2
/// >= -|K c|^2 / l. Over the feasible set of (6) the means c of its factors satisfy sum c c^T <= I,
/// so
///
///     f(R) - f* <= |K|_F^2 / l.
///
/// Rounding: with a computed factor of M, |E|_2 <= (n + 2) u tr M (Higham 2002, Theorem 10.3, and
/// Cauchy-Schwarz), which is taken from l.
///
/// @returns a bound with CertificateMethod::none where the factorisation fails: nothing is known
/// then
inline ComponentBound bound_by_connectivity(const CertificateMatrix& S,
                                            const std::function<bool()>& keep_going) {
  constexpr double part = 0.01;           // l, of the smallest degree
  constexpr double margin = 1.0 + 1e-10;  // for rounding in d, r and the degrees
  const MeasurementGraph& graph = S.graph();
  const Index n = S.num_nodes();
  double min_degree = std::numeric_limits<double>::infinity(), total_degree = 0.0;
  for (const Index i : S.nodes()) {
    min_degree = std::min(min_degree, graph.degree(i));
    total_degree += graph.degree(i);
  }
  const double l = part * min_degree, c = total_degree / n / n;

  // The lower triangle, column by column.
  const auto size = static_cast<std::size_t>(n);
  Buffer M(size * size);
  std::fill_n(M.data(), size * size, c);
  std::vector<double> r(size, 0.0);
  const auto& row = S.components().row_in_component;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const QuaternionEdge& edge = graph.quaternion_edges()[k];
    if (S.components().label[edge.i] != S.component()) continue;
    const Index a = row[edge.i], b = row[edge.j];
    const Vector4& e = S.residuals()()[k];
    const double r_ij = 2.0 * e.head<3>().norm() * e.norm();
    r[a] += r_ij;
    r[b] += r_ij;
    M.data()[std::min(a, b) * size + std::max(a, b)] -= e.squaredNorm();  // the weight
  }
  double trace = 0.0;
  for (Index a = 0; a < n; ++a) {
    const double degree = graph.degree(S.nodes()[a]);
    const double d = -small_eigen(S.diagonal(a) - degree * Matrix3::Identity()).values(0);
    double& diagonal = M.data()[a * size + a];
    diagonal += degree - margin * (d + r[a]) - (margin - 1.0) * degree - l;
    if (!(diagonal > 0.0)) return {};
    trace += diagonal;
  }
  PartialCholesky cholesky;
  if (cholesky(M.data(), n, 0, nullptr, keep_going) != CholeskyOutcome::positive_definite) {
    return {};
  }
  constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
  const double proved = l - 1.1 * (n + 2.0) * unit * trace;
  if (!(proved > 0.0)) return {};

  ComponentBound bound;
  const Eigen::MatrixXd K = S.leftover();
  bound.method = CertificateMethod::connectivity;
  bound.gap = K.squaredNorm() / proved + S.rounding_trace();
  // S >= l on the complement, so the smallest eigenvalue lies between -|K|^2 / (n l) and zero.
  bound.lambda_min =
      lambda_min_near_null_vectors(S, K, -K.squaredNorm() / (n * proved), keep_going);
  return bound;
}

}  // namespace rotavg

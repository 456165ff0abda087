#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/linalg/buffer.hpp>
#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/parallel/interruption.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Proofs at 1/27 of the cost of factorising S or less, for well connected graphs: that the
/// algebraic connectivity exceeds what the residuals can take away.
///
/// In the global frame S = L (x) I_3 + N, with N_ij = -(E_ij - w I) and N_ii = sum (sym E_ij - w
/// I). By blocks, N >= -diag(d_i + r_i) (x) I_3 with
///
///     d_i = |N_ii|_2,     r_i = sum_j |N_ij|_2 = sum_j w 2 sin(angle_ij / 2) = sum_j 2 sqrt(w)
///     |v_ij|
///
/// (Gershgorin, for blocks). For all z orthogonal to the null vectors N = [I … I]^T, and any c,
///
///     z^T S z >= z^T ((L - diag(d + r) + c 1 1^T) (x) I_3) z,
///
/// as the term with c vanishes. That the matrix in the middle is at least l > 0 is proved by its
/// Cholesky factorisation or, near complete graphs, by a norm. Split any x as N c + z: with the
/// leftover K = S N, x^T S x >= 2 c^T K^T z + l |z|^2 >= -|K c|^2 / l. Over the feasible set of (6)
/// the means c of its factors satisfy sum c c^T <= I, so
///
///     f(R) - f* <= |K|_F^2 / l.
class Connectivity {
 public:
  /// @param S must outlive this object
  explicit Connectivity(const CertificateMatrix& S) : S_(S), left_(S.num_nodes(), 0.0) {
    constexpr double margin = 1.0 + 1e-10;  // for rounding in d, r and the degrees
    const MeasurementGraph& graph = S.graph();
    const int num_threads = S.residuals().num_threads();
    parallel_for(S.num_nodes(), num_threads, [&](Index a) {
      const double degree = graph.degree(S.nodes()[a]);
      Matrix3 N = S.diagonal(a);
      add_to_diagonal(N, -degree);
      const double d = -small_eigen(N).values(0);
      // Of many edges, parallel ones among them, d, the reach and the entries of L are long sums.
      const double summing = 2.0 * S.block_rounding(a);
      left_[a] = degree - margin * (d + S.reach(a)) - (margin - 1.0) * degree - summing;
    });
    double min_degree = std::numeric_limits<double>::infinity();
    for (const Index i : S.nodes()) {
      min_degree = std::min(min_degree, graph.degree(i));
      total_degree_ += graph.degree(i);
    }
    // Where the residuals take little away, more is left for l: the smaller is what rounding makes
    // of the gap.
    double least = 1.0;
    for (Index a = 0; a < S.num_nodes(); ++a) {
      least = std::min(least, left_[a] / graph.degree(S.nodes()[a]));
    }
    l_ = (least > low_noise ? large_part : part) * min_degree;
    for (double& left : left_) left -= l_;
    is_positive_ = std::all_of(left_.begin(), left_.end(), [](double x) { return x > 0.0; });
  }

  /// Operations that bound_by_factorization() takes.
  static double flops(double n) { return n * n * n / 3.0; }
  /// So many nodes take so many operations.
  static double nodes(double flops) { return std::cbrt(3.0 * flops); }

  /// By one dense n x n Cholesky factorisation of L - diag(d + r) + c 1 1^T - l I.
  ///
  /// Rounding: with a computed factor of M, |E|_2 <= (n + 2) u tr M (Higham 2002, Theorem 10.3, and
  /// Cauchy-Schwarz), which is taken from l.
  ///
  /// @returns a bound with CertificateMethod::none where the factorisation fails: nothing is known
  ///          then
  ComponentBound bound_by_factorization(const std::function<bool()>& keep_going) const {
    if (!is_positive_) return {};
    const double n = S_.num_nodes(), c = total_degree_ / n / n;
    // The lower triangle, column by column.
    const std::size_t size = left_.size();
    Buffer M(size * size);
    parallel_for(S_.num_nodes(), S_.residuals().num_threads(), [&](Index a) {
      double* const column = M.data() + a * size;
      std::fill(column + a, column + size, c);
      column[a] += left_[a];
      for (const HalfEdge& h : S_.graph().row(S_.nodes()[a])) {
        const Index b = row(h.node);
        if (b > a) column[b] -= S_.graph().weights()[h.edge()];
      }
    });
    double trace = 0.0;
    for (std::size_t a = 0; a < size; ++a) trace += M.data()[a * size + a];
    PartialCholesky cholesky;
    Interruption interruption(keep_going);
    const auto outcome =
        cholesky(M.data(), S_.num_nodes(), 0, nullptr, interruption, S_.residuals().num_threads());
    if (outcome != CholeskyOutcome::positive_definite) return {};
    return bound(l_ - 1.1 * (n + 2.0) * unit_roundoff * trace, keep_going);
  }

  /// From the measurements alone, without any factorisation; about half of all pairs of nodes have
  /// to be joined. With A the weights, L = diag(deg) - A, and D = diag(deg - d - r) - l I,
  ///
  ///     D - A + c 1 1^T > 0   where   |D^-1/2 (A - c 1 1^T) D^-1/2|_F < 1:
  ///
  /// of complete graphs with equal weights the matrix in the middle is -c I.
  ///
  /// @returns a bound with CertificateMethod::none where the norm is larger
  ComponentBound bound_by_norm(const std::function<bool()>& keep_going) const {
    constexpr double almost_one = 0.99, rounding = 1e-7;
    if (!is_positive_) return {};
    // With v_ij = 1 / (D_i D_j), the square is sum v a^2 - 2 c sum v a + c^2 sum v: the least over
    // c. Parallel edges count as one. All in units in which no product overflows, and over pairs
    // of nodes, of which each counts twice.
    const double unit = total_degree_ / S_.num_nodes();
    double sum_v = 0.0, sum_va = 0.0, sum_vaa = 0.0;
    std::vector<double> inverse;  // of D
    for (const double left : left_) sum_v += inverse.emplace_back(unit / left);
    sum_v *= sum_v;
    const std::vector<double>& weights = S_.graph().weights();
    constexpr Index shares = 16;  // of the nodes, each with weights of its own
    std::vector<std::pair<double, double>> of_share(shares);
    parallel_for(shares, S_.residuals().num_threads(), [&](Index share) {
      std::vector<double> weight(left_.size(), 0.0);
      double va = 0.0, vaa = 0.0;
      for (Index a = share; a < S_.num_nodes(); a += shares) {
        const auto half_edges = S_.graph().row(S_.nodes()[a]);
        for (const HalfEdge& h : half_edges) {
          if (row(h.node) > a) weight[row(h.node)] += weights[h.edge()] / unit;
        }
        double va_of_a = 0.0, vaa_of_a = 0.0;
        for (const HalfEdge& h : half_edges) {
          const Index b = row(h.node);
          if (b <= a) continue;
          const double w = std::exchange(weight[b], 0.0), v = w * inverse[b];
          va_of_a += v;
          vaa_of_a += v * w;
        }
        va += inverse[a] * va_of_a;
        vaa += inverse[a] * vaa_of_a;
      }
      of_share[share] = {2.0 * va, 2.0 * vaa};
    });
    for (const auto& [va, vaa] : of_share) {
      sum_va += va;
      sum_vaa += vaa;
    }
    const double square = sum_vaa - sum_va * sum_va / sum_v + rounding * sum_vaa;
    if (!(square < almost_one)) return {};
    return bound(l_, keep_going);
  }

 private:
  static constexpr double part = 0.01, large_part = 0.1;  // l, of the smallest degree
  static constexpr double low_noise = 0.99;               // that much is left of every degree

  Index row(Index node) const { return S_.components().row_in_component[node]; }

  /// @param l what S is at least on the complement of its null vectors
  ComponentBound bound(double l, const std::function<bool()>& keep_going) const {
    if (!(l > 0.0)) return {};
    ComponentBound bound;
    const Eigen::MatrixXd K = S_.leftover();
    double rounding = 0.0;
    for (Index a = 0; a < S_.num_nodes(); ++a) rounding += S_.leftover_rounding(a);
    const double root = K.norm() + std::sqrt(rounding);
    bound.method = CertificateMethod::connectivity;
    bound.is_definite = true;
    bound.gap = (1.0 + 1e-9) * root * root / l;
    bound.rounding = rounding / l;
    // The smallest eigenvalue lies between -|K|^2 / (n l) and zero.
    bound.lambda_min =
        lambda_min_near_null_vectors(S_, K, -K.squaredNorm() / (S_.num_nodes() * l), keep_going);
    return bound;
  }

  const CertificateMatrix& S_;
  std::vector<double> left_;  ///< deg - d - r - l of every node of the component
  double l_ = 0.0, total_degree_ = 0.0;
  bool is_positive_ = false;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

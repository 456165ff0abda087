#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How much rounding can have moved the matrix whose Cholesky factor `BlockCholesky<B>` has
/// computed, known before the factorisation is made: for any A of the pattern with which it runs to
/// its end,
///
///     L L^T = A + E,     |x^T E x| <= sum_i bound_i a_i |x_i|^2,
///
/// with a_i at least the diagonal entries of A in block row i. So if A = M - diag(bound_i a_i) is
/// factorised, M is positive semidefinite, whatever the rounding (Rump 2006, "Verification of
/// positive definiteness", on the filled pattern).
///
/// Why: |E_ij| <= g_ij / (1 - g_jj) sqrt(a_ii a_jj) on the filled pattern and nothing elsewhere,
/// g_ij = gamma_(k+2), gamma_k = k u / (1 - k u), where k counts the nonzeros of row j <= i of L:
/// entry (i, j) is A_ij less at most k - 1 products, summed in any order, then divided by the pivot
/// or rooted; a shift of the diagonal rounds once more (Higham 2002, Lemma 8.4, Theorems 10.3 and
/// 10.5). And 2 |x_i| |x_j| sqrt(a_ii a_jj) <= a_ii x_i^2 + a_jj x_j^2, so bound_i is the sum of g
/// over row and column i, and diagonal entries may differ by any factor.
///
/// @returns one number for each row of the pattern's blocks
inline std::vector<double> cholesky_rounding(const SymbolicCholesky& symbolic, int B) {
  const auto& supernodes = symbolic.supernodes();
  const auto size = static_cast<std::size_t>(symbolic.size());
  std::vector<double> terms(size, 2.0);  // k + 2 of the last row in each block row
  for (const auto& node : supernodes) {
    for (Index k = node.begin; k < node.end; ++k) terms[k] += B * (k - node.begin + 1.0);
    for (const Index row : node.below) terms[row] += B * node.columns();
  }
  std::vector<double> sum(size, 0.0);
  for (const auto& node : supernodes) {
    double of_columns = 0.0;
    for (Index k = node.begin; k < node.end; ++k) {
      of_columns += B * terms[k];  // row k, up to the diagonal
      const double beside = (node.end - k - 1) + node.num_below();
      sum[k] += of_columns + B * beside * terms[k];
    }
    for (const Index row : node.below) sum[row] += of_columns;
  }
  constexpr double margin = 1.01;  // for k u < 0.001: gamma, 1 - g_jj, and this sum's own rounding
  std::vector<double> bound(size);
  for (std::size_t k = 0; k < size; ++k) {
    bound[symbolic.node()[k]] = margin * unit_roundoff * sum[k];
  }
  return bound;
}

/// The same of one factor, known once it is there and closer: tr D for a diagonal D >= 0 with
/// A + shift I + D >= L L^T.
///
/// L L^T = A + shift I + E with |E_ij| <= u k_ij / (1 - u k_ij) (|L| |L|^T)_ij, where k_ij is at
/// most the number of products that were subtracted and three, for the shift and the root (Higham
/// 2002, Theorem 10.3, for any order of the operations). With k_i the number of nonzeros in row i
/// of L and two, k_ij <= sqrt(k_i k_j), so |E| <= u' sum_c a_c a_c^T with a_c = (sqrt(k_i)
/// |L_ic|)_i; and a a^T <= diag(a) sum_i a_i, whose trace is (sum_i a_i)^2.
///
/// @param factor factor(s) is what BlockCholesky<B>::factor(s) is
template <int B, typename Factor>
double rounding_trace(const SymbolicCholesky& symbolic, Factor&& factor) {
  const auto& supernodes = symbolic.supernodes();
  std::vector<double> row_size(static_cast<std::size_t>(symbolic.size()), 2.0);
  std::size_t most_rows = 0;
  for (const Supernode& node : supernodes) {
    for (Index k = node.begin; k < node.end; ++k) row_size[k] += B * (k - node.begin + 1.0);
    for (const Index row : node.below) row_size[row] += B * node.columns();
    most_rows = std::max(most_rows, node.rows());
  }
  double trace = 0.0, largest = 0.0;
  Eigen::VectorXd root(B * most_rows);  // as long as the longest column
  for (std::size_t s = 0; s < supernodes.size(); ++s) {
    const Supernode& node = supernodes[s];
    const auto rows = static_cast<Index>(node.rows());
    for (Index r = 0; r < rows; ++r) {
      const Index row = r < node.columns() ? node.begin + r : node.below[r - node.columns()];
      root.segment<B>(B * r).setConstant(std::sqrt(row_size[row]));
      largest = std::max(largest, row_size[row]);
    }
    const auto L = factor(s);
    for (Eigen::Index c = 0; c < L.cols(); ++c) {
      const Eigen::Index size = B * rows - c;
      const double sum = root.segment(c, size).dot(L.col(c).tail(size).cwiseAbs());
      trace += sum * sum;
    }
  }
  return unit_roundoff / (1.0 - unit_roundoff * largest) * trace;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

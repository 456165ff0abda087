#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Half the distance from one to the next double: the relative error of one operation.
constexpr double unit_roundoff = 0.5 * std::numeric_limits<double>::epsilon();

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

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cstddef>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>

#include <rotavg/linalg/block_pattern.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How many entries each column of the Cholesky factor has, the diagonal included, if the nodes are
/// eliminated in this order (Gilbert, Ng and Peyton 1994): in time nearly linear in the pattern's
/// entries, however many the factor has.
///
/// Row i of the factor is a subtree of the elimination tree, whose leaves are entries of the
/// matrix. So a column has as many entries as there are such subtrees that pass it: each is counted
/// up at its leaves, and down where the paths from two of them meet, and all are summed towards the
/// roots.
inline std::vector<Index> factor_column_counts(const BlockPattern& pattern,
                                               const std::vector<Index>& order) {
  const Index n = pattern.size();
  const auto size = static_cast<std::size_t>(n);
  std::vector<Index> place(size);
  for (Index k = 0; k < n; ++k) place[order[k]] = k;

  // The entries below the diagonal, by columns and by rows, in the order of elimination.
  std::vector<std::vector<Index>> below(size), before(size);
  for (Index j = 0; j < n; ++j) {
    for (Index e = pattern.start[j] + 1; e < pattern.start[j + 1]; ++e) {
      const Index a = place[j], b = place[pattern.row[e]];
      below[a < b ? a : b].push_back(a < b ? b : a);
      before[a < b ? b : a].push_back(a < b ? a : b);
    }
  }

  // The elimination tree (Liu 1990), with shortcuts to the roots known so far.
  std::vector<Index> parent(size, -1), ancestor(size, -1);
  for (Index k = 0; k < n; ++k) {
    for (const Index start : before[k]) {
      for (Index i = start; i != -1 && i != k;) {
        const Index up = std::exchange(ancestor[i], k);
        if (up == -1) parent[i] = k;
        i = up;
      }
    }
  }

  // Postorder: children before their parents, and subtrees in one piece.
  std::vector<Index> child(size, -1), sibling(size, -1), post, stack;
  for (Index k = n; k-- > 0;) {
    if (parent[k] >= 0) sibling[k] = std::exchange(child[parent[k]], k);
  }
  post.reserve(size);
  for (Index root = 0; root < n; ++root) {
    if (parent[root] >= 0) continue;
    stack.push_back(root);
    while (!stack.empty()) {
      const Index top = stack.back();
      if (child[top] >= 0) {
        stack.push_back(child[top]);
        child[top] = sibling[child[top]];
      } else {
        post.push_back(top);
        stack.pop_back();
      }
    }
  }

  std::vector<Index> first(size, -1);  // in postorder, of the descendants
  std::vector<Index> count(size, 0);
  for (Index k = 0; k < n; ++k) {
    if (first[post[k]] == -1) count[post[k]] = 1;  // a leaf of the tree has its diagonal
    for (Index j = post[k]; j != -1 && first[j] == -1; j = parent[j]) first[j] = k;
  }
  std::vector<Index> last_leaf(size, -1), largest_first(size, -1);
  std::iota(ancestor.begin(), ancestor.end(), 0);
  for (const Index j : post) {
    if (parent[j] >= 0) --count[parent[j]];  // the parent's diagonal is not in j's column twice
    for (const Index i : below[j]) {
      if (first[j] <= largest_first[i]) continue;  // below a leaf of row i's subtree
      largest_first[i] = first[j];
      ++count[j];
      const Index before_j = std::exchange(last_leaf[i], j);
      if (before_j == -1) continue;
      Index meet = before_j;
      while (meet != ancestor[meet]) meet = ancestor[meet];
      for (Index s = before_j; s != meet;) s = std::exchange(ancestor[s], meet);
      --count[meet];
    }
    if (parent[j] >= 0) ancestor[j] = parent[j];
  }
  for (const Index j : post) {
    if (parent[j] >= 0) count[parent[j]] += count[j];
  }
  return count;
}

/// Approximate minimum degree by Eigen, where SuiteSparse is missing. Its counts are exact.
/// @throws std::logic_error if the pattern is not that of a symmetric matrix
inline EliminationOrder eigen_minimum_degree(const BlockPattern& pattern) {
  EliminationOrder order;
  const Index n = pattern.size();
  if (n == 0) return order;
  for (Index j = 0; j < n; ++j) {
    Index above = j - 1;
    for (Index e = pattern.start[j]; e < pattern.start[j + 1]; ++e) {
      if (pattern.row[e] <= above || pattern.row[e] >= n) {
        throw std::logic_error("the pattern is not that of a symmetric matrix");
      }
      above = pattern.row[e];
    }
  }
  const std::vector<float> ones(pattern.row.size(), 1.0F);
  const Eigen::Map<const Eigen::SparseMatrix<float, Eigen::ColMajor, Index>> matrix(
      n, n, static_cast<Eigen::Index>(pattern.row.size()), pattern.start.data(), pattern.row.data(),
      ones.data());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, Index> permutation;
  Eigen::AMDOrdering<Index>()(matrix.selfadjointView<Eigen::Lower>(), permutation);
  order.node.assign(permutation.indices().data(), permutation.indices().data() + n);
  for (const Index entries : factor_column_counts(pattern, order.node)) {
    const double below = entries - 1.0;
    order.nonzeros += below;
    // Divisions, the lower half of the outer product, and the root.
    order.multiplications += below + 0.5 * below * (below + 1.0) + 1.0;
  }
  return order;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

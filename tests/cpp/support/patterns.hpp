#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/block_pattern.hpp>
#include <rotavg/types.hpp>

#include "blocks.hpp"
#include "graphs.hpp"
#include "random.hpp"

namespace rotavg::test {

inline std::vector<Index> numbers(Index n) {
  std::vector<Index> all(static_cast<std::size_t>(n));
  std::iota(all.begin(), all.end(), 0);
  return all;
}

inline EliminationOrder random_order(Random& random, Index n) {
  EliminationOrder order{numbers(n)};
  std::shuffle(order.node.begin(), order.node.end(), random.generator());
  return order;
}

/// The rows of every column of L below the diagonal, by elimination of one column after the other.
inline std::vector<std::vector<Index>> rows_of_factor(const BlockPattern& pattern,
                                                      const std::vector<Index>& node) {
  const Index n = pattern.size();
  std::vector<Index> column_of(node.size());
  for (Index k = 0; k < n; ++k) column_of[node[k]] = k;
  std::vector<std::vector<bool>> filled(node.size(), std::vector<bool>(node.size(), false));
  for (Index j = 0; j < n; ++j) {
    for (Index e = pattern.start[j]; e < pattern.start[j + 1]; ++e) {
      const auto [column, row] = std::minmax(column_of[j], column_of[pattern.row[e]]);
      filled[column][row] = true;
    }
  }
  std::vector<std::vector<Index>> rows(node.size());
  for (Index k = 0; k < n; ++k) {
    for (Index i = k + 1; i < n; ++i) {
      if (filled[k][i]) rows[k].push_back(i);
    }
    for (const Index i : rows[k]) {
      for (const Index j : rows[k]) {
        if (i > j) filled[j][i] = true;
      }
    }
  }
  return rows;
}

/// Divisions and roots count as multiplications.
inline double multiplications_of(const std::vector<std::vector<Index>>& rows) {
  double sum = 0.0;
  for (const auto& column : rows) {
    const auto below = static_cast<double>(column.size());
    sum += 0.5 * (below + 1.0) * (below + 2.0);
  }
  return sum;
}

inline BlockPattern pattern_of(Index n, const Pairs& pairs) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Identity(n, n);
  for (const auto& [i, j] : pairs) A(i, j) = A(j, i) = 1.0;
  return sparse_blocks<1>(A).pattern;
}

}  // namespace rotavg::test

#pragma once

#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// Where a symmetric matrix of blocks has entries: its lower triangle by columns, in compressed
/// form. The rows of a column rise, and the first is the diagonal.
struct BlockPattern {
  std::vector<Index> start = {0};  ///< (n + 1,) where each column begins in `row`
  std::vector<Index> row;

  Index size() const { return static_cast<Index>(start.size()) - 1; }
};

/// An order of elimination that keeps the Cholesky factor sparse.
struct EliminationOrder {
  std::vector<Index> node;  ///< (n,) the node that is eliminated k-th
  /// Multiplications that a factorisation in this order takes at most, divisions and roots
  /// included, with blocks of size one; for blocks of size B about B^3 times as many.
  double multiplications = 0.0;
  double nonzeros = 0.0;  ///< of the factor below the diagonal, about, with blocks of size one
};

}  // namespace rotavg

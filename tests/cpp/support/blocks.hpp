#pragma once

#include <algorithm>
#include <memory>

#include <Eigen/Core>

#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/types.hpp>

#include "graphs.hpp"
#include "random.hpp"

namespace rotavg::test {

/// The lower triangle of a symmetric matrix of B x B blocks.
template <int B>
struct SparseBlocks {
  BlockPattern pattern;
  typename BlockCholesky<B>::Blocks blocks;
};

/// All blocks of a dense matrix that are not zero, and all diagonal ones.
template <int B>
SparseBlocks<B> sparse_blocks(const Eigen::MatrixXd& symmetric) {
  SparseBlocks<B> sparse;
  const auto n = static_cast<Index>(symmetric.rows() / B);
  for (Index j = 0; j < n; ++j) {
    for (Index i = j; i < n; ++i) {
      const Eigen::Matrix<double, B, B> block = symmetric.block<B, B>(B * i, B * j);
      if (i > j && (block.array() == 0.0).all()) continue;
      sparse.pattern.row.push_back(i);
      sparse.blocks.push_back(block);
    }
    sparse.pattern.start.push_back(static_cast<Index>(sparse.pattern.row.size()));
  }
  return sparse;
}

/// Both triangles of a matrix from the blocks of its lower one.
template <int B>
Eigen::MatrixXd dense_symmetric(const BlockPattern& pattern,
                                const typename BlockCholesky<B>::Blocks& blocks) {
  const Eigen::Index size = B * pattern.size();
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(size, size);
  for (Index j = 0; j < pattern.size(); ++j) {
    for (Index e = pattern.start[j]; e < pattern.start[j + 1]; ++e) {
      const Index i = pattern.row[e];
      A.block<B, B>(B * i, B * j) = blocks[e];
      A.block<B, B>(B * j, B * i) = blocks[e].transpose();
    }
  }
  return A;
}

inline Eigen::MatrixXd normal_matrix(Random& random, Eigen::Index rows, Eigen::Index columns) {
  return Eigen::MatrixXd::NullaryExpr(rows, columns,
                                      [&](Eigen::Index, Eigen::Index) { return random.normal(); });
}

/// Random blocks on the diagonal and where two nodes are joined; eigenvalues of both signs.
template <int B>
Eigen::MatrixXd random_symmetric(Random& random, Index n, const Pairs& pairs) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(B * n, B * n);
  for (Index i = 0; i < n; ++i) {
    const Eigen::MatrixXd block = normal_matrix(random, B, B);
    A.block<B, B>(B * i, B * i) = block + block.transpose();
  }
  for (const auto& [i, j] : pairs) {
    A.block<B, B>(B * i, B * j) = normal_matrix(random, B, B);
    A.block<B, B>(B * j, B * i) = A.block<B, B>(B * i, B * j).transpose();
  }
  return A;
}

inline Eigen::MatrixXd shifted(Eigen::MatrixXd A, double shift) {
  A.diagonal().array() += shift;
  return A;
}

/// In the order of approximate minimum degree or, as the elimination tree is then seldom in
/// postorder and L fuller, in a random one.
inline std::shared_ptr<const SymbolicCholesky> analysed(Random& random, const BlockPattern& pattern,
                                                        bool shuffled) {
  EliminationOrder order = approximate_minimum_degree(pattern);
  if (shuffled) std::shuffle(order.node.begin(), order.node.end(), random.generator());
  return std::make_shared<const SymbolicCholesky>(pattern, order);
}

/// All of L in the order of elimination.
template <int B>
Eigen::MatrixXd dense_factor(const BlockCholesky<B>& cholesky) {
  Eigen::MatrixXd L = Eigen::MatrixXd::Zero(cholesky.size(), cholesky.size());
  const auto& supernodes = cholesky.symbolic()->supernodes();
  for (std::size_t s = 0; s < supernodes.size(); ++s) {
    const auto& node = supernodes[s];
    const Eigen::MatrixXd columns = cholesky.factor(s).template triangularView<Eigen::Lower>();
    const Index width = B * node.columns();
    L.block(B * node.begin, B * node.begin, width, width) = columns.topRows(width);
    for (Index r = 0; r < node.num_below(); ++r) {
      L.block(B * node.below[r], B * node.begin, B, width) = columns.middleRows<B>(width + B * r);
    }
  }
  return L;
}

/// P A P^T, rows and columns in the order of elimination.
template <int B>
Eigen::MatrixXd permuted(const Eigen::MatrixXd& A, const SymbolicCholesky& symbolic) {
  const auto& node = symbolic.node();
  Eigen::MatrixXd PAP(A.rows(), A.cols());
  for (Index j = 0; j < symbolic.size(); ++j) {
    for (Index i = 0; i < symbolic.size(); ++i) {
      PAP.block<B, B>(B * i, B * j) = A.block<B, B>(B * node[i], B * node[j]);
    }
  }
  return PAP;
}

}  // namespace rotavg::test

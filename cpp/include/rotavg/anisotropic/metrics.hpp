#pragma once

#include <algorithm>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/hessian.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The inverse of the Hessian at some rotations, but for the turns p of its edges; the first node
/// of every component is held.
class BlockMetric {
 public:
  /// @param eliminations of all components, without their roots; must outlive this object
  explicit BlockMetric(std::vector<Elimination>& eliminations) : eliminations_(eliminations) {}

  CholeskyOutcome factorize(const AnisotropicResiduals& residuals,
                            const std::function<bool()>& keep_going) {
    factors_.clear();
    for (Elimination& elimination : eliminations_) {
      if (elimination.size() == 0) continue;
      factors_.push_back(
          {&elimination, BlockCholesky<3>(elimination.symbolic(), elimination.num_threads())});
      const auto outcome = factors_.back().cholesky.factorize(
          hessian_blocks(residuals, elimination, /*with_turns=*/false), 0.0, keep_going);
      if (outcome != CholeskyOutcome::positive_definite) return outcome;
    }
    return CholeskyOutcome::positive_definite;
  }

  void apply(const NodeVectors& v, NodeVectors& result) {
    result.setZero(v.rows(), 3);
    for (Factor& factor : factors_) {
      const Elimination& elimination = *factor.elimination;
      free_.resize(3 * static_cast<Eigen::Index>(elimination.size()), 1);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) free_(3 * a + k, 0) = v(elimination.node(a), k);
      }
      factor.cholesky.solve_in_place(free_);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) result(elimination.node(a), k) = free_(3 * a + k, 0);
      }
    }
  }

 private:
  struct Factor {
    const Elimination* elimination;
    BlockCholesky<3> cholesky;
  };

  std::vector<Elimination>& eliminations_;
  std::vector<Factor> factors_;
  Eigen::MatrixXd free_;
};

/// The inverse of the Hessian's diagonal blocks, but for what its edges turn: for graphs whose
/// factors are too large, most of which are well connected.
class DiagonalMetric {
 public:
  explicit DiagonalMetric(const AnisotropicResiduals& residuals)
      : num_threads_(residuals.num_threads()), inverse_(residuals.graph().num_nodes()) {
    const AnisotropicGraph& graph = residuals.graph();
    parallel_for(graph.num_nodes(), num_threads_, [&](Index i) {
      Matrix3 sum = Matrix3::Zero();
      for (const HalfEdge& h : graph.row(i)) sum += residuals()[h.edge()].T;
      const SymmetricEigen eigen = symmetric_eigen(sum);
      const double floor = 1e-6 * eigen.values(2);  // what is known less, sweeps would not move
      Vector3 inverse = Vector3::Zero();
      for (int k = 0; k < 3; ++k) {
        if (eigen.values(2) > 0.0) inverse(k) = 0.5 / std::max(eigen.values(k), floor);
      }
      inverse_[i] =
          product_transposed(product(eigen.vectors, Matrix3(inverse.asDiagonal())), eigen.vectors);
    });
  }

  void apply(const NodeVectors& v, NodeVectors& result) const {
    result.resize(v.rows(), 3);
    parallel_for(static_cast<Index>(v.rows()), num_threads_, [&](Index i) {
      const Vector3 z = product(inverse_[i], Vector3(v(i, 0), v(i, 1), v(i, 2)));
      for (int k = 0; k < 3; ++k) result(i, k) = z(k);
    });
  }

 private:
  int num_threads_;
  std::vector<Matrix3> inverse_;
};

/// What Newton's steps take for the inverse of the Hessian.
enum class MetricKind {
  blocks,    ///< BlockMetric
  scalar,    ///< LaplacianMetric, of one weight for each edge
  diagonal,  ///< DiagonalMetric
};

/// The one that is predicted to take least. A scalar Laplacian takes 1/27 of the operations that
/// its blocks of 3 x 3 do, but the more conjugate gradients the less even the precisions are: on
/// lattices of 1:2:2.9 and 1:3:10 twice and three times as many.
inline MetricKind metric_kind(const AnisotropicGraph& graph,
                              std::vector<Elimination>& eliminations) {
  constexpr double steps = 10.0;  // of conjugate gradients, where all axes are known alike
  // What a step takes, in operations of a factorisation: for an entry of the factor, for an edge.
  constexpr double per_entry = 40.0, per_block = 160.0, per_edge = 600.0;
  constexpr double max_flops = 1e10;  // as without covariances
  double scalar = 0.0, blocks = 0.0, entries = 0.0, scalar_bytes = 0.0, bytes = 0.0;
  for (Elimination& elimination : eliminations) {
    scalar += elimination.flops(1, max_flops);
    if (scalar > max_flops) return MetricKind::diagonal;
    blocks += elimination.flops(3, 27.0 * max_flops);
    entries += elimination.nonzeros();
    scalar_bytes += elimination.factor_bytes(1);
    bytes += elimination.factor_bytes(3);
  }
  if (!has_memory_for(scalar_bytes)) return MetricKind::diagonal;
  if (blocks > max_flops || !has_memory_for(bytes)) return MetricKind::scalar;
  const double more_steps = (graph.unevenness() - 1.0) * steps;
  scalar += more_steps * per_edge * graph.num_edges();
  scalar += (steps + more_steps) * per_entry * entries;
  blocks += steps * per_block * entries;
  return scalar < blocks ? MetricKind::scalar : MetricKind::blocks;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

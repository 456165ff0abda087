#pragma once

#include <memory>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/split.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/lifted.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the staircase climbs on measurements with full covariances: a problem with blocks W >= 0,
/// whose relaxation (6) is of use where that of the blocks themselves is not.
///
/// Lifted to more than three dimensions, Y_i^T Y_j may be any X with |X| <= 1, reflections among
/// them: where M = tr(H) / 2 I - H has a negative eigenvalue, as with precisions 1:3:10, f itself
/// falls there far below what rotations reach, and its lifted optimum is of no use. But with the
/// split of anisotropic/split.hpp taken where the edge fits, M = P + W, the part of P is least at
/// R_i R_ij = R_j over rotations, so
///
///     f(R) >= f_W(R) = sum |(R_i R_ij - R_j) W^(1/2)|_F^2 = sum 2 (tr W - tr(R_i R_ij W R_j^T)),
///
/// W = tr(H - Q) / 2 I - (H - Q), for all rotations, and f_W is a sum of squares in any number of
/// dimensions. Precisions h I have W = h / 2 I: there it is f. It is a start, whose basins do not
/// depend on where the climb began, and its relaxed optimum a bound on f, below it by what the
/// noise costs along the axes whose precision was given up.
///
/// (A connection, as LiftedProblemOf asks for: in the global frame of some rotations R.)
class Minorant {
 public:
  /// Of an edge, in the global frame.
  struct Block {
    Matrix3 E;  ///< R_i R_ij R_j^T
    Matrix3 W;  ///< R_j W R_j^T
  };

  /// @param graph must outlive this object and its copies, which share the blocks
  /// @param q world_from_i, one unit quaternion per node
  Minorant(const AnisotropicGraph& graph, const Quaternions& q, int num_threads)
      : graph_(&graph), num_threads_(num_threads) {
    // Less what rounding can have added, so that what is given up is admissible outright.
    constexpr double relative = 100.0 * unit_roundoff;
    const auto& edges = graph.scalar().quaternion_edges();
    std::vector<Block> blocks(edges.size());
    parallel_for(graph.num_edges(), num_threads, [&](Index k) {
      const Matrix3& H = graph.precisions()[k];
      Matrix3 W = half_trace_less(H - closed_form_split(H));
      add_to_diagonal(W, -relative * H.trace());
      const Matrix3 R_i = q[edges[k].i].toRotationMatrix(), R_j = q[edges[k].j].toRotationMatrix();
      const Matrix3 R_ij = graph.scalar().edges()[k].i_from_j();
      blocks[k].E = product_transposed(product(R_i, R_ij), R_j);
      blocks[k].W = symmetric_part(product_transposed(product(R_j, W), R_j));
    });
    blocks_ = std::make_shared<const std::vector<Block>>(std::move(blocks));
  }

  const MeasurementGraph& graph() const { return graph_->scalar(); }
  int num_threads() const { return num_threads_; }
  const Block& operator[](Index edge) const { return (*blocks_)[edge]; }

 private:
  const AnisotropicGraph* graph_;
  int num_threads_;
  std::shared_ptr<const std::vector<Block>> blocks_;
};

inline Matrix3 connection_block(const Minorant& minorant, Index edge, bool is_i) {
  const Matrix3 block = product(minorant[edge].E, minorant[edge].W);
  return is_i ? block : Matrix3(block.transpose());
}
/// The sum of tr(H), of which no W exceeds the half: room for the rounding of the turns.
inline double connection_degree(const Minorant& minorant, Index i) {
  return 6.0 * minorant.graph().degree(i);
}
inline double connection_weight(const Minorant& minorant) {
  return 24.0 * minorant.graph().total_weight();
}

/// tr(W D D^T), D = E^T Z_a - Z_b.
inline double lifted_cost(const Minorant& minorant, Index edge, const LiftedBlocks& Z, Index a,
                          Index b) {
  const Minorant::Block& block = minorant[edge];
  double sum = 0.0;
  for (Eigen::Index c = 0; c < Z.cols(); ++c) {
    const Vector3 z_a = Z.col(c).segment<3>(3 * a), z_b = Z.col(c).segment<3>(3 * b);
    const Vector3 d = block.E.transpose() * z_a - z_b;
    sum += d.dot(block.W * d);
  }
  return sum;
}

/// Of f_W over free 3 x 3 matrices, and a little more: W may be singular.
inline BlockCholesky<3>::Blocks connection_laplacian(const Minorant& minorant,
                                                     Elimination& elimination) {
  constexpr double little = 1e-6;
  return elimination.assemble<3>(
      [&](Index i) {
        Matrix3 sum = multiple_of_identity(little * connection_degree(minorant, i));
        for (const HalfEdge& h : minorant.graph().row(i)) {
          const Minorant::Block& block = minorant[h.edge()];
          sum += h.is_i() ? product_transposed(product(block.E, block.W), block.E) : block.W;
        }
        return sum;
      },
      [&](Index k) -> Matrix3 { return -connection_block(minorant, k, /*is_i=*/true); });
}

}  // namespace rotavg

#pragma GCC diagnostic pop

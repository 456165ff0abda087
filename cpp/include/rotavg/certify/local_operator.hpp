#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/operator_columns.hpp>
#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

struct LocalOperatorNode {
  Matrix3 R, Lambda;  ///< world_from_i; the diagonal block in the frame of i
  double degree;
};

/// M = D^-1/2 S D^-1/2 of one component, D the degrees, on the complement of D^1/2 N: the operator
/// of the iterations that factorise nothing. Its spectrum lies below 2.
///
/// It works in local frames, where S = Lambda(R) - Rt has the measurements themselves beside the
/// diagonal: they are read in order, once per product, from rows of their own.
///
/// @tparam C columns
template <int C>
class LocalOperator : public OperatorColumns<LocalOperator<C>, C> {
 public:
  using Columns = OperatorColumns<LocalOperator<C>, C>;
  using Block = typename Columns::Block;
  using Vectors = typename Columns::Vectors;

  /// @param S must outlive this object
  /// @param q world_from_i, of every node of the graph: where S was taken
  LocalOperator(const CertificateMatrix& S, const Quaternions& q)
      : S_(S),
        num_threads_(S.residuals().num_threads()),
        rows_(std::make_shared<const HalfEdgeRows>(S.graph(), HalfEdgeRows::Only{S.nodes()},
                                                   num_threads_)) {
    std::vector<Node> nodes(S.nodes().size());
    for (Index a = 0; a < S.num_nodes(); ++a) {
      const Index i = S.nodes()[a];
      const Matrix3 R = q[i].toRotationMatrix();
      nodes[a] = {R, product(transposed_product(R, S.diagonal(a)), R), S.graph().degree(i)};
      total_degree_ += nodes[a].degree;
    }
    nodes_ = std::make_shared<const std::vector<Node>>(std::move(nodes));
  }

  /// The same with other columns.
  template <int K>
  explicit LocalOperator(const LocalOperator<K>& other)
      : S_(other.S_),
        num_threads_(other.num_threads_),
        rows_(other.rows_),
        nodes_(other.nodes_),
        total_degree_(other.total_degree_) {}

  Index num_nodes() const { return S_.num_nodes(); }
  int num_threads() const { return num_threads_; }
  /// D at a node.
  double degree(Index a) const { return (*nodes_)[a].degree; }
  /// A vector in the frame of a node, in the global one.
  Vector3 in_global_frame(Index a, const Vector3& z) const { return product((*nodes_)[a].R, z); }
  /// The other way round: what has a row for each coordinate.
  Matrix3 in_own_frame(Index a, const Matrix3& x) const {
    return transposed_product((*nodes_)[a].R, x);
  }
  /// Of the complement.
  Eigen::Index dimension() const { return S_.size() - 3; }

  /// Bounds the rounding of one product, |computed - M y| <= rounding() |y|: that of the blocks,
  /// which is symmetric, 40 u for the turn into local frames, (q + 6) u |M| |y| for the sums at a
  /// node, and those over all nodes of project().
  double rounding() const {
    double worst = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) {
      const double blocks = S_.block_rounding(a) / (*nodes_)[a].degree;
      const double sums = 4.0 * (S_.graph().row(S_.nodes()[a]).size() + 16.0) * unit_roundoff;
      worst = std::max(worst, blocks + sums);
    }
    return worst + this->rounding_of_sums();
  }

  /// result <- scale D^-1 S z + shift z + old result * factor
  void apply(const Vectors& z, double scale, double shift, double factor, Vectors& result) const {
    const std::vector<Index>& row = S_.components().row_in_component;
    parallel_for(num_nodes(), num_threads_, [&](Index a) {
      const Node& node = (*nodes_)[a];
      Block sum = Block::Zero();
      if (is_far(z) && a + 1 < num_nodes()) {
        for (const HalfEdge& h : rows_->row(a + 1)) prefetch_object(z[row[h.node]]);
      }
      for (const HalfEdge& h : rows_->row(a)) {
        this->add_product(MeasurementGraph::block(h), z[row[h.node]], sum);
      }
      Block diagonal = Block::Zero();
      this->add_product(node.Lambda, z[a], diagonal);
      const double s = scale / node.degree;
      for (int k = 0; k < 3 * C; ++k) {
        result[a](k) = s * (diagonal(k) - sum(k)) + shift * z[a](k) + factor * result[a](k);
      }
    });
  }

  /// Onto the complement: N^T D z = 0, with a block R_i^T of N for every node.
  void project(Vectors& z) const {
    auto mean = block_sum<Sums<3 * C>>(num_nodes(), this->node_threads(), [&](Index a) {
      Block turned = Block::Zero();
      this->add_product((*nodes_)[a].R, z[a], turned);
      Sums<3 * C> along;
      for (int k = 0; k < 3 * C; ++k) along.value[k] = (*nodes_)[a].degree * turned(k);
      return along;
    });
    for (double& entry : mean.value) entry /= total_degree_;
    parallel_for(num_nodes(), this->node_threads(), [&](Index a) {
      const Matrix3& R = (*nodes_)[a].R;
      for (int c = 0; c < C; ++c) {
        const double* const x = mean.value + 3 * c;
        for (int r = 0; r < 3; ++r) z[a](r, c) -= R(0, r) * x[0] + R(1, r) * x[1] + R(2, r) * x[2];
      }
    });
  }

 private:
  template <int K>
  friend class LocalOperator;

  using Node = LocalOperatorNode;

  const CertificateMatrix& S_;
  int num_threads_;
  std::shared_ptr<const HalfEdgeRows> rows_;
  std::shared_ptr<const std::vector<Node>> nodes_;
  double total_degree_ = 0.0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

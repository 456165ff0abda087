#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// M = D^-1/2 S D^-1/2 of one component, D the degrees, on the complement of D^1/2 N: the operator
/// of the iterations that factorise nothing. Its spectrum lies below 2.
///
/// It works in local frames, where S = Lambda(R) - Rt has the measurements themselves beside the
/// diagonal: they are read in order, once per product, and nothing else of the edges is kept. And
/// it works on z = D^-1/2 y, C columns side by side, in the inner product z^T D z = |y|^2.
///
/// @tparam C columns
template <int C>
class LocalOperator {
 public:
  using Block = Eigen::Matrix<double, 3, C>;
  using Vectors = std::vector<Block, Eigen::aligned_allocator<Block>>;  ///< one for each node
  using Row = Eigen::Array<double, 1, C>;

  /// @param S must outlive this object
  /// @param q world_from_i, of every node of the graph: where S was taken
  LocalOperator(const CertificateMatrix& S, const Quaternions& q)
      : S_(S), num_threads_(S.residuals().num_threads()) {
    nodes_.resize(S.nodes().size());
    for (Index a = 0; a < S.num_nodes(); ++a) {
      const Index i = S.nodes()[a];
      const Matrix3 R = q[i].toRotationMatrix();
      nodes_[a] = {R, transposed_product(R, S.diagonal(a)) * R, S.graph().degree(i)};
      total_degree_ += nodes_[a].degree;
    }
  }

  Index num_nodes() const { return S_.num_nodes(); }
  /// Of the complement.
  Eigen::Index dimension() const { return S_.size() - 3; }

  /// Bounds the rounding of one product, |computed - M y| <= rounding() |y|: that of the blocks,
  /// which is symmetric, 40 u for the turn into local frames, and (q + 6) u |M| |y| for the sums.
  double rounding() const {
    double worst = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) {
      const double blocks = S_.block_rounding(a) / nodes_[a].degree;
      const double sums = 4.0 * (S_.graph().row(S_.nodes()[a]).size() + 16.0) * unit_roundoff;
      worst = std::max(worst, blocks + sums);
    }
    return worst;
  }

  /// result <- scale D^-1 S z + shift z + old result * factor
  void apply(const Vectors& z, double scale, double shift, double factor, Vectors& result) const {
    const std::vector<Index>& row = S_.components().row_in_component;
    parallel_for(num_nodes(), num_threads_, [&](Index a) {
      const Node& node = nodes_[a];
      Block sum = Block::Zero();
      const auto half_edges = S_.graph().row(S_.nodes()[a]);
      for (const HalfEdge& h : half_edges) prefetch(&z[row[h.node]]);
      for (const HalfEdge& h : half_edges) {
        sum += MeasurementGraph::block(h).lazyProduct(z[row[h.node]]);
      }
      sum = node.Lambda.lazyProduct(z[a]) - sum;
      result[a] = (scale / node.degree) * sum + shift * z[a] + factor * result[a];
    });
  }

  /// Onto the complement: N^T D z = 0, with a block R_i^T of N for every node.
  void project(Vectors& z) const {
    const auto along = block_sum<Zeroed<Block>>(num_nodes(), num_threads_, [&](Index a) {
      const Node& node = nodes_[a];
      return Block(node.degree * node.R.lazyProduct(z[a]));
    });
    const Block mean = along.value / total_degree_;
    parallel_for(num_nodes(), num_threads_,
                 [&](Index a) { z[a] -= nodes_[a].R.transpose().lazyProduct(mean); });
  }

  /// Of every column of x and of y, x^T D y.
  Row products(const Vectors& x, const Vectors& y) const {
    return block_sum<Zeroed<Row>>(num_nodes(), num_threads_,
                                  [&](Index a) {
                                    Row row;
                                    for (int c = 0; c < C; ++c) {
                                      row(c) = x[a](0, c) * y[a](0, c) + x[a](1, c) * y[a](1, c) +
                                               x[a](2, c) * y[a](2, c);
                                      row(c) *= nodes_[a].degree;
                                    }
                                    return row;
                                  })
        .value;
  }

  /// Columns that are uniform on the unit sphere of the complement.
  Vectors random(std::uint64_t seed) const {
    constexpr double two_pi = 6.283185307179586;
    std::mt19937_64 generator(seed);
    Vectors z(nodes_.size());
    for (Index a = 0; a < num_nodes(); ++a) {  // y is normal (Box and Muller)
      for (Eigen::Index k = 0; k < z[a].size(); ++k) {
        const double radius = std::sqrt(-2.0 * std::log1p(-random_unit(generator)));
        z[a](k) = radius * std::cos(two_pi * random_unit(generator)) / std::sqrt(nodes_[a].degree);
      }
    }
    project(z);
    const Row squares = products(z, z);
    for (Block& block : z) {
      for (Eigen::Index k = 0; k < block.size(); ++k) block(k) /= std::sqrt(squares(k / 3));
    }
    return z;
  }

 private:
  static void prefetch(const void* address) {
#ifdef __GNUC__
    __builtin_prefetch(address);
#else
    (void)address;
#endif
  }

  struct Node {
    Matrix3 R, Lambda;  ///< world_from_i; the diagonal block in the frame of i
    double degree;
  };
  /// A sum that begins with zeros.
  template <typename Value>
  struct Zeroed {
    Value value = Value::Zero();
    Zeroed() = default;
    Zeroed& operator+=(const Zeroed& other) {
      value += other.value;
      return *this;
    }
    Zeroed& operator+=(const Value& other) {
      value += other;
      return *this;
    }
  };

  const CertificateMatrix& S_;
  int num_threads_;
  std::vector<Node> nodes_;
  double total_degree_ = 0.0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

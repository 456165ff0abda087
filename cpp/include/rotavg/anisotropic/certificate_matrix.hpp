#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/split.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// S of one connected component (anisotropic/split.hpp), in the global frame:
///
///     S_ij = - sum (W + [p]),     S_ii = sum W.
///
/// As in the isotropic CertificateMatrix, N^T S N = 0 with N = [I … I]^T at any rotations, and S N
/// is the leftover of the gradient.
class AnisotropicCertificateMatrix {
 public:
  /// @param splits, components must outlive this object
  AnisotropicCertificateMatrix(const EdgeSplits& splits, const Components& components,
                               Index component)
      : graph_(splits.residuals().graph()),
        num_threads_(splits.residuals().num_threads()),
        components_(components),
        nodes_(components.nodes[component]),
        force_(splits.residuals()()),
        W_(force_.size()),
        diagonal_(nodes_.size(), Matrix3::Zero()),
        scale_(nodes_.size(), 0.0),
        precision_(nodes_.size(), 0.0),
        pull_(nodes_.size(), 0.0) {
    for (Index a = 0; a < num_nodes(); ++a) {
      for (const HalfEdge& h : graph_.row(nodes_[a])) {
        if (!h.is_i()) continue;
        const Index k = h.edge(), b = row(h.node);
        edges_.push_back({k, a, b});
        W_[k] = splits.W(k);
        const double trace = graph_.precisions()[k].trace();
        const double size = W_[k].norm() + force_[k].p.norm() + 0.1 * trace;
        for (const Index end : {a, b}) {
          diagonal_[end] += W_[k];
          scale_[end] += size;
          precision_[end] += trace;
          pull_[end] += force_[k].p.norm();
        }
      }
    }
    loose_ = precision_;
  }

  /// S less a share of the edges' W where these are positive definite, S - kappa L_W: where that
  /// is positive, the rounding of the leftover need not be held against the nodes alone.
  ///
  /// Of the error dv of v, at most 32 u, every edge adds some [d] to K at one end and -[d] at the
  /// other, d = T dv + 600 u tr(H) |v|. So with S_r >= kappa L_W what they make of the bound is at
  /// most the sum of tr([d]^T W^-1 [d]) / kappa, and
  ///
  ///     tr([d]^T W^-1 [d]) = d^T A d,     A = tr(W^-1) I - W^-1.
  AnisotropicCertificateMatrix less_firm_edges(double kappa) const {
    AnisotropicCertificateMatrix less = *this;
    for (const Edge& e : edges_) {
      const EdgeForce& force = force_[e.edge];
      const double trace = graph_.precisions()[e.edge].trace();
      const SymmetricEigen eigen = symmetric_eigen(W_[e.edge]);
      if (!is_firm(eigen, trace)) continue;
      const Vector3 inverse = eigen.values.cwiseInverse();
      const Matrix3 turned = product(force.T, eigen.vectors);
      double square = 0.0;  // tr(T A T)
      for (int c = 0; c < 3; ++c) {
        square += (inverse.sum() - inverse(c)) * turned.col(c).squaredNorm();
      }
      const double size =
          32.0 * std::sqrt(square) + 600.0 * trace * force.sine * std::sqrt(2.0 * inverse(0));
      less.edge_rounding_ += std::pow(1.01 * unit_roundoff * size, 2) / kappa;
      less.W_[e.edge] *= 1.0 - kappa;
      for (const Index end : {e.i, e.j}) {
        less.diagonal_[end] -= kappa * W_[e.edge];
        less.loose_[end] -= trace;
      }
    }
    for (double& loose : less.loose_) loose = std::max(loose, 0.0);
    return less;
  }

  /// A t with S >= L_W - t diag(scale), L_W that of the edges of which less_firm_edges() takes. An
  /// edge adds d^T W d - 2 x_i . p x x_j, which is at least d^T W d - |p| (|x_i|^2 + |x_j|^2), and
  /// d^T W d at least -2 max(-lambda_min(W), 0) (|x_i|^2 + |x_j|^2) where it is not firm.
  double below_firm_edges() const {
    std::vector<double> below(nodes_.size());
    for (Index a = 0; a < num_nodes(); ++a) below[a] = pull_[a] + block_rounding(a);
    for (const Edge& e : edges_) {
      const SymmetricEigen eigen = symmetric_eigen(W_[e.edge]);
      if (is_firm(eigen, graph_.precisions()[e.edge].trace())) continue;
      for (const Index end : {e.i, e.j}) below[end] += 2.0 * std::max(-eigen.values(0), 0.0);
    }
    double most = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) most = std::max(most, below[a] / scale_[a]);
    return most;
  }

  /// An edge of the component, its ends as rows.
  struct Edge {
    Index edge, i, j;
  };

  const std::vector<Edge>& edges() const { return edges_; }
  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  Eigen::Index size() const { return 3 * static_cast<Eigen::Index>(num_nodes()); }
  Index num_edges_at(Index a) const { return static_cast<Index>(graph_.row(nodes_[a]).size()); }
  int num_threads() const { return num_threads_; }
  /// At least the largest absolute entry of the blocks in row a, and of their sum.
  double scale(Index a) const { return scale_[a]; }
  double least_scale() const { return *std::min_element(scale_.begin(), scale_.end()); }

  /// S X, without forming S.
  Eigen::MatrixXd apply(const Eigen::MatrixXd& X) const {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
    for (const Edge& e : edges_) {
      const Vector3& p = force_[e.edge].p;
      for (Eigen::Index c = 0; c < X.cols(); ++c) {
        const Vector3 x_i = X.col(c).segment<3>(3 * e.i), x_j = X.col(c).segment<3>(3 * e.j);
        const Vector3 d = x_i - x_j, stretch = W_[e.edge] * d;
        Y.col(c).segment<3>(3 * e.i) += stretch - cross(p, x_j);
        Y.col(c).segment<3>(3 * e.j) += cross(p, x_i) - stretch;
      }
    }
    return Y;
  }

  /// add(S_ab, b) for all blocks of row a.
  template <typename Add>
  void add_row(Index a, Add&& add) const {
    add(diagonal_[a], a);
    for (const HalfEdge& h : graph_.row(nodes_[a])) {
      const Vector3& p = force_[h.edge()].p;
      add(Matrix3(-(W_[h.edge()] + hat(h.is_i() ? p : Vector3(-p)))), row(h.node));
    }
  }

  /// S N: -[g_i / 4] with g the gradient.
  Eigen::MatrixXd leftover() const {
    std::vector<Vector3> sum(nodes_.size(), Vector3::Zero());
    for (const Edge& e : edges_) {
      sum[e.i] -= force_[e.edge].p;
      sum[e.j] += force_[e.edge].p;
    }
    Eigen::MatrixXd K(size(), 3);
    for (Index a = 0; a < num_nodes(); ++a) K.middleRows<3>(3 * a) = hat(sum[a]);
    return K;
  }

  /// S + diag(shift), without the nodes that the elimination skips.
  /// @param shift (n,) one number for each node of the component
  BlockCholesky<3>::Blocks blocks(Elimination& elimination,
                                  const std::vector<double>& shift) const {
    return elimination.assemble<3>(
        [&](Index i) {
          const Index a = row(i);
          Matrix3 block = diagonal_[a];
          add_to_diagonal(block, shift[a]);
          return block;
        },
        [&](Index k) { return Matrix3(-(W_[k] + hat(force_[k].p))); });
  }

  /// How far rounding can have moved S as a quadratic form: by at most sum_a block_rounding(a)
  /// |x_a|^2. (W is what it is, EdgeSplits::W: only its sums round, and W + [p].) The turn p, of a
  /// residual quaternion with an error of 32 u and an H with one of 40 u, is off by 200 u tr(H).
  double block_rounding(Index a) const {
    const double terms = 8.0 * graph_.row(nodes_[a]).size() + 16.0;
    return unit_roundoff * (terms * scale_[a] + 200.0 * precision_[a]);
  }
  /// The same of the leftover's block at a: a bound on |dK_a|_F, but for the errors of the edges
  /// that were taken away.
  double leftover_rounding(Index a) const {
    const double additions = 16.0 * graph_.row(nodes_[a]).size() + 32.0;
    return unit_roundoff * (additions * pull_[a] + 400.0 * loose_[a]);
  }
  /// What those errors amount to: the square of what is to be added to the root of the bound.
  double leftover_edge_rounding() const { return edge_rounding_; }

 private:
  static bool is_firm(const SymmetricEigen& of_W, double trace) {
    constexpr double least = 1e-6;  // of the precision: W is no better known than T
    return of_W.values(0) > least * trace;
  }

  Index row(Index node) const { return components_.row_in_component[node]; }

  const AnisotropicGraph& graph_;
  int num_threads_;
  const Components& components_;
  const std::vector<Index>& nodes_;
  const LargeVector<EdgeForce>& force_;
  std::vector<Matrix3> W_;  ///< of every edge of the graph; those of other components are not set
  std::vector<Edge> edges_;
  std::vector<Matrix3> diagonal_;
  std::vector<double> scale_;
  std::vector<double> precision_;  ///< sum of tr(H) at every node
  std::vector<double> pull_;       ///< sum of |p| at every node
  std::vector<double> loose_;      ///< sum of tr(H) of the edges of which nothing was taken away
  double edge_rounding_ = 0.0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

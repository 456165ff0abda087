#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// S = Lambda - E (Theorem 1) of one component at a lifted point (problem/lifted.hpp); as
/// CertificateMatrix, but for its null vectors, which are the columns of Z.
///
/// @tparam Connection the blocks E_ij, as of LiftedProblemOf
template <typename Connection>
class LiftedCertificateMatrix {
 public:
  /// @param connection, components, Lambda (LiftedPoint) must outlive this object
  /// @param null_vectors 3n x k, orthonormal
  LiftedCertificateMatrix(const Connection& connection, const Components& components,
                          Index component, const std::vector<Matrix3>& Lambda,
                          Eigen::MatrixXd null_vectors)
      : connection_(connection),
        components_(components),
        component_(component),
        nodes_(components.nodes[component]),
        Lambda_(Lambda),
        null_vectors_(std::move(null_vectors)) {}

  const MeasurementGraph& graph() const { return connection_.graph(); }
  const Components& components() const { return components_; }
  Index component() const { return component_; }
  Index num_nodes() const { return static_cast<Index>(nodes_.size()); }
  Eigen::Index size() const { return 3 * static_cast<Eigen::Index>(num_nodes()); }
  double degree(Index a) const { return connection_degree(connection_, nodes_[a]); }
  double max_degree() const {
    double largest = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) largest = std::max(largest, degree(a));
    return largest;
  }

  /// S X, without forming S.
  Eigen::MatrixXd apply(const Eigen::MatrixXd& X) const {
    Eigen::MatrixXd Y = apply_connection(connection_, components_, component_, X);
    parallel_for(num_nodes(), connection_.num_threads(), [&](Index a) {
      Y.middleRows<3>(3 * a) *= -1.0;
      add_block_product(Lambda_[a], X, a, Y, a);
    });
    return Y;
  }

  /// D^-1 X, every node's rows divided by its degree.
  Eigen::MatrixXd divide_by_degree(Eigen::MatrixXd X) const {
    for (Index a = 0; a < num_nodes(); ++a) X.middleRows<3>(3 * a) /= degree(a);
    return X;
  }

  /// 3n x k, orthonormal: those of S at a stationary point.
  const Eigen::MatrixXd& null_vectors() const { return null_vectors_; }
  Eigen::MatrixXd leftover() const { return std::sqrt(double(num_nodes())) * apply(null_vectors_); }

  /// What rounding in the blocks adds to tr(S Y), as that of CertificateMatrix.
  double rounding_trace() const {
    double sum = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) {
      sum += (3.0 * (graph().row(nodes_[a]).size() + 64.0) + 371.0) * degree(a);
    }
    return unit_roundoff * sum;
  }

  /// S without the nodes that the elimination skips.
  BlockCholesky<3>::Blocks blocks(Elimination& elimination) const {
    return elimination.assemble<3>(
        [&](Index i) -> const Matrix3& { return Lambda_[components_.row_in_component[i]]; },
        [&](Index k) -> Matrix3 { return -connection_block(connection_, k, /*is_i=*/true); });
  }

 private:
  const Connection& connection_;
  const Components& components_;
  Index component_;
  const std::vector<Index>& nodes_;
  const std::vector<Matrix3>& Lambda_;  ///< of the nodes of the component
  Eigen::MatrixXd null_vectors_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

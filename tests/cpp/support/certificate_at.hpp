#pragma once

#include <cmath>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/quaternion.hpp>

#include "dense.hpp"

namespace rotavg::test {

/// S with all that it refers to.
struct CertificateAt {
  Components components;
  Quaternions q;
  ResidualQuaternions residuals;
  NodeSums sums;
  CertificateMatrix S;

  CertificateAt(const MeasurementGraph& graph, const Rotations& R)
      : components(connected_components(graph)),
        q(to_quaternions(R)),
        residuals(graph, q, 1),
        sums(residuals),
        S(sums, components, 0) {}
  CertificateAt(const CertificateAt&) = delete;
};

/// N, 3n x 3, with D^1/2 N of orthonormal columns.
inline Eigen::MatrixXd scaled_null_vectors(const MeasurementGraph& graph, const Rotations& R) {
  Eigen::MatrixXd N(3 * graph.num_nodes(), 3);
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    N.middleRows<3>(3 * i) = std::sqrt(graph.degree(i)) * R[i].transpose();
  }
  return N / std::sqrt(2.0 * graph.total_weight());
}

/// D^-1/2 A D^-1/2 on the complement of D^1/2 N, and a large multiple of the identity on the rest.
inline Eigen::MatrixXd scaled_on_complement(const MeasurementGraph& graph, const Rotations& R,
                                            Eigen::MatrixXd A) {
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    const double root = std::sqrt(graph.degree(i));
    A.middleRows<3>(3 * i) /= root;
    A.middleCols<3>(3 * i) /= root;
  }
  const Eigen::MatrixXd N = scaled_null_vectors(graph, R);
  const Eigen::MatrixXd P = Eigen::MatrixXd::Identity(A.rows(), A.rows()) - N * N.transpose();
  return P * A * P + 10.0 * N * N.transpose();
}

/// Eigenvalues, rising, of D^-1/2 S D^-1/2 on the complement of D^1/2 N.
inline Eigen::VectorXd scaled_eigenvalues(const MeasurementGraph& graph, const Rotations& R) {
  const Eigen::MatrixXd S = dense_certificate_matrix(graph, R);
  // The null vectors go to the far end.
  return dense_eigenvalues(scaled_on_complement(graph, R, S)).head(S.rows() - 3);
}

}  // namespace rotavg::test

#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#include "graphs.hpp"
#include "random.hpp"

// What the tests of full covariances share: graphs with them, and the objective by its definition.

namespace rotavg::test {

/// V diag(a, b, c) V^T with random axes.
inline Matrix3 with_eigenvalues(Random& random, const Vector3& values) {
  const Matrix3 V = random.rotation();
  const Matrix3 H = V * values.asDiagonal() * V.transpose();
  return symmetric_part(H);
}

/// Measurements with noise of the covariance H^-1, H with eigenvalues up to 100 : 1, of about
/// `noise` radians.
inline AnisotropicGraph anisotropic_graph(Random& random, const Pairs& pairs, double noise) {
  const Rotations truth = random.rotations(num_nodes(pairs));
  std::vector<RelativeRotation> measurements;
  std::vector<Matrix3> precisions;
  for (const auto& [i, j] : pairs) {
    const Matrix3 V = random.rotation();
    Vector3 deviation, normal;
    for (int k = 0; k < 3; ++k) {
      deviation(k) = noise * random.power_of_ten(-1.0, 0.0);
      normal(k) = random.normal();
    }
    const Vector3 e = V * deviation.cwiseProduct(normal);
    measurements.push_back({i, j, truth[i].transpose() * truth[j] * exp_so3(e), 1.0});
    const Vector3 precision = deviation.cwiseProduct(deviation).cwiseInverse();
    precisions.push_back(symmetric_part(V * precision.asDiagonal() * V.transpose()));
  }
  return {MeasurementGraph(measurements), precisions};
}

/// sum 2 (tr M - tr(R_i R_ij M R_j^T)), M = tr(H) / 2 I - H.
inline double objective_by_definition(const AnisotropicGraph& graph, const Rotations& R) {
  double sum = 0.0;
  for (std::size_t k = 0; k < graph.precisions().size(); ++k) {
    const Edge& e = graph.scalar().edges()[k];
    const Matrix3& H = graph.precisions()[k];
    const Matrix3 M = 0.5 * H.trace() * Matrix3::Identity() - H;
    sum += 2.0 * (M.trace() - (R[e.i] * e.i_from_j() * M * R[e.j].transpose()).trace());
  }
  return sum;
}

inline AnisotropicResiduals residuals_at(const AnisotropicGraph& graph, const Rotations& R) {
  return {graph, to_quaternions(R), 1};
}

}  // namespace rotavg::test

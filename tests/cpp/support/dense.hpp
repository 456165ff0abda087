#pragma once

#include <Eigen/Core>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg::test {

/// The paper's Rt (4), 3n x 3n, straight from its definition.
inline Eigen::MatrixXd dense_measurements(const MeasurementGraph& graph) {
  const Eigen::Index size = 3 * graph.num_nodes();
  Eigen::MatrixXd Rt = Eigen::MatrixXd::Zero(size, size);
  for (const Edge& e : graph.edges()) {
    Rt.block<3, 3>(3 * e.i, 3 * e.j) += e.weight * e.i_from_j();
    Rt.block<3, 3>(3 * e.j, 3 * e.i) += e.weight * e.i_from_j().transpose();
  }
  return Rt;
}

/// R = [R_1 … R_n], 3 x 3n.
inline Eigen::MatrixXd stacked(const Rotations& R) {
  Eigen::MatrixXd side_by_side(3, 3 * static_cast<Eigen::Index>(R.size()));
  for (std::size_t i = 0; i < R.size(); ++i) {
    side_by_side.middleCols<3>(3 * static_cast<Eigen::Index>(i)) = R[i];
  }
  return side_by_side;
}

/// S = Lambda - Rt (5), Lambda symmetrised block by block.
inline Eigen::MatrixXd dense_certificate_matrix(const MeasurementGraph& graph, const Rotations& R) {
  const Eigen::MatrixXd Rt = dense_measurements(graph);
  const Eigen::MatrixXd sums = Rt * stacked(R).transpose();  // block i: sum_j Rt_ij R_j^T
  Eigen::MatrixXd S = -Rt;
  for (Eigen::Index i = 0; i < graph.num_nodes(); ++i) {
    const Matrix3 M = sums.middleRows<3>(3 * i) * R[static_cast<std::size_t>(i)];
    S.block<3, 3>(3 * i, 3 * i) += 0.5 * (M + M.transpose());
  }
  return S;
}

/// Blocks R_i S_ij R_j^T: the same matrix, turned from the frames of the nodes to the global one.
inline Eigen::MatrixXd in_global_frame(Eigen::MatrixXd S, const Rotations& R) {
  for (std::size_t i = 0; i < R.size(); ++i) {
    const auto at = 3 * static_cast<Eigen::Index>(i);
    S.middleRows<3>(at) = (R[i] * S.middleRows<3>(at)).eval();
    S.middleCols<3>(at) = (S.middleCols<3>(at) * R[i].transpose()).eval();
  }
  return S;
}

/// Rising. (Compiled once, as it takes the compiler seconds.)
Eigen::VectorXd dense_eigenvalues(const Eigen::MatrixXd& symmetric);

}  // namespace rotavg::test

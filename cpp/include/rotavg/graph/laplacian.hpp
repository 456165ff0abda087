#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// L X with L = D - W the scalar weighted graph Laplacian of one component.
inline Eigen::MatrixXd apply_laplacian(const MeasurementGraph& graph, const Components& components,
                                       Index component, const Eigen::MatrixXd& X) {
  const auto& nodes = components.nodes[component];
  Eigen::MatrixXd Y(X.rows(), X.cols());
  for (std::size_t a = 0; a < nodes.size(); ++a) {
    const auto row = static_cast<Eigen::Index>(a);
    const double degree = graph.degree(nodes[a]);
    for (Eigen::Index c = 0; c < X.cols(); ++c) Y(row, c) = degree * X(row, c);
    for (const HalfEdge& h : graph.row(nodes[a])) {
      const double weight = graph.edges()[h.edge()].weight;
      const Index other = components.row_in_component[h.node];
      for (Eigen::Index c = 0; c < X.cols(); ++c) Y(row, c) -= weight * X(other, c);
    }
  }
  return Y;
}

/// L of one component without the nodes that the elimination skips: positive definite if that is at
/// least one.
/// @param weights (m,) of the edges
inline BlockCholesky<1>::Blocks grounded_laplacian(const MeasurementGraph& graph,
                                                   Elimination& elimination,
                                                   const std::vector<double>& weights) {
  using Scalar = Eigen::Matrix<double, 1, 1>;
  const auto degree = [&](Index i) {
    double sum = 0.0;
    for (const HalfEdge& h : graph.row(i)) sum += weights[h.edge()];
    return Scalar(sum);
  };
  return elimination.assemble<1>(degree, [&](Index k) { return Scalar(-weights[k]); });
}
inline BlockCholesky<1>::Blocks grounded_laplacian(const MeasurementGraph& graph,
                                                   Elimination& elimination) {
  return grounded_laplacian(graph, elimination, graph.weights());
}

}  // namespace rotavg

#pragma GCC diagnostic pop

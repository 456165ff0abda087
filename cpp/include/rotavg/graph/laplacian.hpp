#pragma once

#include <Eigen/Core>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// L of one component without the nodes that the elimination skips: positive definite if that is at
/// least one.
inline BlockCholesky<1>::Blocks grounded_laplacian(const MeasurementGraph& graph,
                                                   Elimination& elimination) {
  using Scalar = Eigen::Matrix<double, 1, 1>;
  return elimination.assemble<1>([&](Index i) { return Scalar(graph.degree(i)); },
                                 [&](Index k) { return Scalar(-graph.edges()[k].weight); });
}

}  // namespace rotavg

#pragma GCC diagnostic pop

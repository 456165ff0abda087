#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>

#include <Eigen/Core>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/algebraic_connectivity.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/lobpcg.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

ROTAVG_INLINE double algebraic_connectivity(const MeasurementGraph& graph,
                                            const Components& components, Index component,
                                            const std::function<bool()>& keep_going) {
  const auto& nodes = components.nodes[component];
  const auto n = static_cast<Eigen::Index>(nodes.size());
  if (n < 2) return std::numeric_limits<double>::quiet_NaN();
  double max_degree = 0.0;
  for (const Index i : nodes) max_degree = std::max(max_degree, graph.degree(i));

  constexpr double max_flops = 2e10;
  Elimination elimination(graph, components, component);
  std::optional<BlockCholesky<1>> cholesky;
  if (elimination.flops(1, max_flops) <= max_flops) {
    cholesky.emplace(elimination.symbolic());
    if (cholesky->factorize(grounded_laplacian(graph, elimination), 0.0, keep_going) !=
        CholeskyOutcome::positive_definite) {
      cholesky.reset();
    }
  }
  const LinearOperator precondition = [&](const Eigen::MatrixXd& X) -> Eigen::MatrixXd {
    if (!cholesky) {  // so dense that the degrees do nearly as well
      Eigen::MatrixXd Y = X;
      for (Eigen::Index a = 0; a < n; ++a) Y.row(a) /= graph.degree(nodes[a]);
      return Y;
    }
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), X.cols());
    Y.bottomRows(n - 1) = cholesky->solve(X.bottomRows(n - 1));
    return Y;
  };
  LobpcgOptions options;
  options.tolerance = 1e-9 * max_degree;
  options.keep_going = keep_going;
  const Eigen::MatrixXd ones = Eigen::MatrixXd::Constant(n, 1, 1.0 / std::sqrt(double(n)));
  const Eigenpair pair = smallest_eigenpair(
      [&](const Eigen::MatrixXd& X) { return apply_laplacian(graph, components, component, X); },
      precondition, random_start(n, std::min<Eigen::Index>(3, n - 1)), ones, options);
  const bool stopped = keep_going && !keep_going();
  return stopped ? std::numeric_limits<double>::quiet_NaN() : pair.value;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/selected_inverse.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// The factor of a component's grounded Laplacian; null where it would take more than so many
/// operations, or on being stopped.
inline std::unique_ptr<BlockCholesky<1>> laplacian_factor(const MeasurementGraph& graph,
                                                          Elimination& elimination,
                                                          double max_flops, int num_threads,
                                                          const std::function<bool()>& keep_going) {
  if (elimination.flops(1, max_flops) > max_flops) return nullptr;
  auto cholesky = std::make_unique<BlockCholesky<1>>(elimination.symbolic(), num_threads);
  const auto outcome = cholesky->factorize(grounded_laplacian(graph, elimination), 0.0, keep_going);
  return outcome == CholeskyOutcome::positive_definite ? std::move(cholesky) : nullptr;
}

}  // namespace detail

/// The effective resistances between pairs of nodes, (e_i - e_j)^T L^+ (e_i - e_j), where the
/// weights are conductances: of measurements with these precisions the variance with which least
/// squares know one node from another, per axis and unit variance of the noise.
///
/// Estimated from random right-hand sides (Spielman and Srivastava 2011): with z of independent
/// signs and L y = B^T W^1/2 z, the mean of (y_i - y_j)^2 is the resistance; that of thirty-two is
/// good to a quarter (one standard deviation). It takes the memory of 64 numbers a node.
///
/// @param pairs of nodes, of one component each
/// @param max_flops where the factorisation of a component would take more, there is no result
/// @param keep_going asked every few milliseconds of a factorisation; where it says false, there is
///        no result
inline std::optional<std::vector<double>> effective_resistances(
    const MeasurementGraph& graph, const std::vector<std::pair<Index, Index>>& pairs,
    double max_flops, int num_threads, const std::function<bool()>& keep_going = {}) {
  constexpr int samples = 32;
  const Components components = connected_components(graph);
  std::mt19937_64 generator(0x5eed);
  Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(samples, graph.num_nodes());  // a node's are together
  for (const Edge& e : graph.edges()) {
    const double root = std::sqrt(e.weight);
    std::uint64_t signs = generator();
    for (int s = 0; s < samples; ++s, signs >>= 1) {
      const double current = (signs & 1) != 0 ? root : -root;
      Y(s, e.i) += current;
      Y(s, e.j) -= current;
    }
  }
  for (Elimination& elimination : grounded_eliminations(graph, components, num_threads)) {
    if (elimination.size() == 0) continue;
    const auto cholesky =
        detail::laplacian_factor(graph, elimination, max_flops, num_threads, keep_going);
    if (!cholesky) return std::nullopt;
    Eigen::MatrixXd X(elimination.size(), samples);
    for (Index a = 0; a < elimination.size(); ++a) X.row(a) = Y.col(elimination.node(a));
    cholesky->solve_in_place(X);
    for (Index a = 0; a < elimination.size(); ++a) Y.col(elimination.node(a)) = X.row(a);
    Y.col(elimination.root()).setZero();
  }
  std::vector<double> resistances;
  resistances.reserve(pairs.size());
  for (const auto& [i, j] : pairs) {
    resistances.push_back((Y.col(i) - Y.col(j)).squaredNorm() / samples);
  }
  return resistances;
}

/// The effective resistances R (m,) between the ends of every edge, exactly: from the entries of
/// the inverse where the factor has entries, as it has at every edge. Of least squares, 1 / weight
/// - R is the variance of the edge's own residual, per axis and unit variance of the noise: zero of
/// a bridge.
///
/// @param max_flops, keep_going as above
inline std::optional<std::vector<double>> edge_resistances(
    const MeasurementGraph& graph, double max_flops, int num_threads,
    const std::function<bool()>& keep_going = {}) {
  const Components components = connected_components(graph);
  std::vector<double> resistances(graph.edges().size(), 0.0);
  for (Elimination& elimination : grounded_eliminations(graph, components, num_threads)) {
    if (elimination.size() == 0) continue;
    const auto cholesky =
        detail::laplacian_factor(graph, elimination, max_flops, num_threads, keep_going);
    if (!cholesky) return std::nullopt;
    const SelectedInverse<1> inverse(*cholesky, keep_going);
    if (inverse.stopped()) return std::nullopt;
    const auto row = [&](Index i) {
      return i == elimination.root() ? -1 : components.row_in_component[i] - elimination.skipped();
    };
    const auto entry = [&](Index a, Index b) { return a < 0 || b < 0 ? 0.0 : inverse(a, b)(0, 0); };
    for (const Index i : components.nodes[elimination.component()]) {
      for (const HalfEdge& h : graph.row(i)) {
        if (graph.edges()[h.edge()].i != i) continue;  // once, from its first end
        const Index a = row(i), b = row(h.node);
        resistances[h.edge()] = entry(a, a) + entry(b, b) - 2.0 * entry(a, b);
      }
    }
  }
  return resistances;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/node_rows.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/small_inverse.hpp>
#include <rotavg/poses/positions.hpp>
#include <rotavg/problem/check_precisions.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// One least-squares problem: p_j - p_i ~ step, weighed with blocks of size B. Where they are
/// scalars, x, y and z part, and are three right-hand sides.
template <int B>
class PositionFit {
 public:
  using Block = Eigen::Matrix<double, B, B>;

  /// @param steps, weights (m,) of the edges, in the world
  PositionFit(const MeasurementGraph& graph, std::vector<Vector3> steps, std::vector<Block> weights)
      : graph_(graph), steps_(std::move(steps)), weights_(std::move(weights)) {
    double largest = 0.0;
    for (const Block& W : weights_) {
      for (int k = 0; k < B * B; ++k) largest = std::max(largest, std::abs(W(k)));
    }
    for (Block& W : weights_) W /= largest;
  }

  /// Solves for those nodes of a component that the elimination does not skip.
  /// @param known (n,) whether a node's position is held
  /// @returns whether they can be solved for
  bool solve(Elimination& elimination, const std::vector<bool>& known, std::vector<Vector3>& p) {
    if (elimination.size() == 0) return true;
    BlockCholesky<B> cholesky(elimination.symbolic(), elimination.num_threads());
    const auto degree = [&](Index i) {
      Block sum = Block::Zero();
      for (const HalfEdge& h : graph_.row(i)) sum += weights_[h.edge()];
      return sum;
    };
    const auto laplacian =
        elimination.template assemble<B>(degree, [&](Index k) -> Block { return -weights_[k]; });
    if (cholesky.factorize(laplacian) != CholeskyOutcome::positive_definite) return false;
    std::vector<Vector3> asked;  // of every row: W times where its edges want it
    for (Index a = 0; a < elimination.size(); ++a) {
      asked.push_back(Vector3::Zero());
      for (const HalfEdge& h : graph_.row(elimination.node(a))) {
        Vector3 there = h.is_i() ? Vector3(-steps_[h.edge()]) : steps_[h.edge()];
        if (known[h.node]) there += p[h.node];
        asked.back() += weighed(weights_[h.edge()], there);
      }
    }
    cholesky.solve_entries(
        3 / B, [&](Index row, int t) { return asked[row / B](row % B + t); },
        [&](Index row, int t, double solved) {
          p[elimination.node(row / B)](row % B + t) = solved;
        });
    for (Index a = 0; a < elimination.size(); ++a) {
      if (!is_finite(p[elimination.node(a)])) return false;
    }
    return true;
  }

 private:
  static Vector3 weighed(const Block& W, const Vector3& v) {
    if constexpr (B == 1) {
      return W(0) * v;
    } else {
      return product(W, v);
    }
  }

  const MeasurementGraph& graph_;
  std::vector<Vector3> steps_;
  std::vector<Block> weights_;
};

/// Puts the nodes that are held first in their components, and holds the first where none is.
/// @returns how many are held in each
inline std::vector<Index> known_first(Components& components, std::vector<bool>& known) {
  std::vector<Index> count;
  for (std::vector<Index>& nodes : components.nodes) {
    const auto is_known = [&](Index i) { return known[i]; };
    if (std::none_of(nodes.begin(), nodes.end(), is_known)) known[nodes.front()] = true;
    const auto end = std::stable_partition(nodes.begin(), nodes.end(), is_known);
    count.push_back(static_cast<Index>(end - nodes.begin()));
    for (std::size_t a = 0; a < nodes.size(); ++a) {
      components.row_in_component[nodes[a]] = static_cast<Index>(a);
    }
  }
  return count;
}

/// Checks what was measured of translations; whether every information is a multiple of I.
inline bool checked_translations(const MeasurementGraph& graph,
                                 const std::vector<Vector3>& translations,
                                 std::vector<Matrix3>& information) {
  const auto m = static_cast<std::size_t>(graph.num_edges());
  if (translations.size() != m) {
    throw std::invalid_argument("found " + std::to_string(translations.size()) +
                                " translations; expected " + std::to_string(m) +
                                ", one for each edge");
  }
  if (information.empty()) information.assign(m, Matrix3::Identity());
  if (information.size() != m) {
    throw std::invalid_argument(
        "found the information about " + std::to_string(information.size()) +
        " translations; expected it of " + std::to_string(m) + ", one for each edge");
  }
  bool scalar = true;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (!is_finite(translations[k])) {
      throw InvalidEdge(k, "the translation holds a NaN or an infinity");
    }
    checked_precision(k, information[k]);
    const Matrix3& Omega = information[k];
    if (!has_positive_minors(Omega)) {
      throw InvalidEdge(k, "the information about the translation is not positive definite");
    }
    for (int a = 0; a < 9; ++a) scalar = scalar && Omega(a) == (a % 4 == 0 ? Omega(0) : 0.0);
  }
  return scalar;
}

}  // namespace detail

ROTAVG_INLINE std::vector<Vector3> positions(const MeasurementGraph& graph, const Rotations& given,
                                             const std::vector<Vector3>& translations,
                                             const std::vector<Matrix3>& given_information,
                                             const std::vector<FixedPosition>& fixed) {
  std::vector<Matrix3> information = given_information;
  const bool scalar = detail::checked_translations(graph, translations, information);
  const Rotations R = checked_rotations(graph, given);
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  std::vector<Vector3> p(n, Vector3::Zero());
  std::vector<bool> known(n, false);
  const NodeRows rows(graph.nodes());
  for (const FixedPosition& held : fixed) {
    const auto refuse = [&](const char* why) {
      throw std::invalid_argument("the fixed position of node " + std::to_string(held.node) + why);
    };
    const Index row = rows.find(held.node);
    if (row < 0) refuse(" is of no node of the graph");
    if (known[row]) refuse(" is given twice");
    if (!is_finite(held.position)) refuse(" holds a NaN or an infinity");
    known[row] = true;
    p[row] = held.position;
  }

  std::vector<Vector3> steps;
  std::vector<Eigen::Matrix<double, 1, 1>> weights;
  std::vector<Matrix3> blocks;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge e = graph.edges()[k];
    steps.push_back(product(R[e.i], translations[k]));
    if (scalar) {
      weights.emplace_back(information[k](0));
    } else {
      const Matrix3 world_from_j = product(R[e.i], e.i_from_j());
      const Matrix3 turned = product(world_from_j, information[k]);
      blocks.push_back(symmetric_part(product_transposed(turned, world_from_j)));
    }
  }
  Components components = connected_components(graph);
  const std::vector<Index> num_known = detail::known_first(components, known);
  const auto solve = [&](auto&& fit) {
    for (Index c = 0; c < components.size(); ++c) {
      Elimination elimination(graph, components, c, num_known[c]);
      if (!fit.solve(elimination, known, p)) {
        throw std::invalid_argument(
            "the positions cannot be solved for: the numbers of the translations and their "
            "information are too large or too far apart");
      }
    }
  };
  if (scalar) {
    solve(detail::PositionFit<1>(graph, std::move(steps), std::move(weights)));
  } else {
    solve(detail::PositionFit<3>(graph, std::move(steps), std::move(blocks)));
  }
  return p;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

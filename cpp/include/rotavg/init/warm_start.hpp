#pragma once

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/node_rows.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A start from pieces, each of which is known up to a rotation of its own: nodes of a piece keep
/// their rotations relative to each other, and what belongs to no piece is one by itself.
///
/// Of pieces A and B an edge (i, j) between them measures A_from_B = R_i R_ij R_j^T. These are the
/// edges of a graph whose nodes are the pieces, and its spanning_tree_init(), rooted at the largest
/// piece of each component, turns them: every piece meets one edge exactly, of several the one that
/// most others agree with. Exact where neither pieces nor edges have errors.
///
/// @param R (n,) world_from_i of the nodes in pieces; that of the others is not used
/// @param piece (n,) label from 0 to n - 1 of every node's piece, -1 for a node in none
/// @throws std::invalid_argument unless there is a label in this range for each node
/// @throws InvalidRotation as checked_rotations()
inline Rotations join_pieces(const MeasurementGraph& graph, Rotations R, std::vector<Index> piece) {
  const Index n = graph.num_nodes();
  if (static_cast<Index>(piece.size()) != n || static_cast<Index>(R.size()) != n) {
    throw std::invalid_argument("found " + std::to_string(R.size()) + " rotations and " +
                                std::to_string(piece.size()) + " labels of pieces; expected " +
                                std::to_string(n) + ", one for each node");
  }
  std::vector<std::vector<Index>> nodes(piece.size());  // of every piece
  for (Index i = 0; i < n; ++i) {
    if (piece[i] < -1 || piece[i] >= n) {
      throw std::invalid_argument("found the label " + std::to_string(piece[i]) +
                                  " of a piece; expected -1 to " + std::to_string(n - 1));
    }
    if (piece[i] >= 0) nodes[piece[i]].push_back(i);
  }
  for (Index i = 0; i < n; ++i) {
    if (piece[i] >= 0) continue;
    R[i].setIdentity();
    nodes.push_back({i});
  }
  R = checked_rotations(graph, std::move(R));

  // The largest come first, so that they are roots.
  std::stable_sort(nodes.begin(), nodes.end(),
                   [](const auto& a, const auto& b) { return a.size() > b.size(); });
  while (nodes.back().empty()) nodes.pop_back();
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    for (const Index i : nodes[k]) piece[i] = static_cast<Index>(k);
  }
  std::vector<RelativeRotation> between;
  for (const Edge& e : graph.edges()) {
    if (piece[e.i] == piece[e.j]) continue;
    between.push_back(
        {piece[e.i], piece[e.j], product_transposed(R[e.i] * e.i_from_j(), R[e.j]), e.weight});
  }
  if (between.empty()) return R;
  std::vector<NodeId> pieces(nodes.size());
  std::iota(pieces.begin(), pieces.end(), NodeId{0});
  const Rotations world_from_piece = spanning_tree_init(MeasurementGraph(between, pieces));
  for (Index i = 0; i < n; ++i) R[i] = world_from_piece[piece[i]] * R[i];
  return R;
}

/// A start from what was found for another graph: one that had fewer or more nodes and edges. Its
/// nodes are found again by their ids; every component of it, as far as it is still there, is a
/// piece of join_pieces().
///
/// @param graph what is to be solved
/// @param other the graph that was solved
/// @param R, components of the solution of `other`
/// @throws std::invalid_argument if no node of `graph` is in `other`, or if the solution is not one
///         of `other`
inline Rotations warm_start(const MeasurementGraph& graph, const MeasurementGraph& other,
                            const Rotations& R, const Components& components) {
  const auto num_rotations = static_cast<Index>(R.size());
  if (num_rotations != other.num_nodes() || components.label.size() != R.size()) {
    throw std::invalid_argument("found " + std::to_string(num_rotations) +
                                " rotations and components of " +
                                std::to_string(components.label.size()) + " nodes; expected " +
                                std::to_string(other.num_nodes()) + ", as the solved graph has");
  }
  const NodeRows rows(other.nodes());
  Rotations start(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  std::vector<Index> piece(start.size(), -1), label_of(components.nodes.size(), -1);
  Index num_pieces = 0;
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    const Index row = rows.find(graph.nodes()[i]);
    if (row < 0) continue;
    Index& label = label_of[components.label[row]];
    if (label < 0) label = num_pieces++;
    start[i] = R[row];
    piece[i] = label;
  }
  if (num_pieces == 0) throw std::invalid_argument("the two graphs have no node in common");
  return join_pieces(graph, std::move(start), std::move(piece));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// R_j at one end of an edge from R_i at the other: R_i R_ij, or R_i R_ji^T.
inline Matrix3 along_edge(const Edge& e, const Matrix3& R_i, Index j) {
  Matrix3 from_j = e.i_from_j();
  if (e.j != j) from_j.transposeInPlace();
  // Through a quaternion of length one, so that rounding does not pile up along long paths.
  return renormalized(product(R_i, from_j));
}

/// The shortest-path initial value (Lemma 3): R = I at the first node of every component, and
/// R_i = R_12 R_23 … R_mi along a shortest path from there. Optimal where there is no noise.
/// @param forest of the graph
inline Rotations shortest_path_init(const MeasurementGraph& graph,
                                    const BreadthFirstForest& forest) {
  Rotations R(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  for (const Index j : forest.order) {
    if (forest.parent[j] < 0) continue;
    R[j] = along_edge(graph.edges()[forest.tree_edge[j]], R[forest.parent[j]], j);
  }
  return R;
}
inline Rotations shortest_path_init(const MeasurementGraph& graph) {
  return shortest_path_init(graph, breadth_first_forest(graph));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <Eigen/Geometry>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The shortest-path initial value (Lemma 3): R = I at the first node of every component, and
/// R_i = R_12 R_23 … R_mi along a shortest path from there. Optimal where there is no noise.
inline Rotations shortest_path_init(const MeasurementGraph& graph) {
  const BreadthFirstForest forest = breadth_first_forest(graph);
  Rotations R(static_cast<std::size_t>(graph.num_nodes()), Matrix3::Identity());
  for (const Index j : forest.order) {
    if (forest.parent[j] < 0) continue;
    const Edge& e = graph.edges()[forest.tree_edge[j]];
    const Matrix3 parent_from_j = e.j == j ? e.i_from_j : Matrix3(e.i_from_j.transpose());
    // Through a quaternion of length one, so that rounding does not pile up along long paths.
    R[j] = Eigen::Quaterniond(R[forest.parent[j]] * parent_from_j).normalized().matrix();
  }
  return R;
}

}  // namespace rotavg

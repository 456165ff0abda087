#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/online/component.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The core of a component as solve() takes it, and back.
struct CoreOfComponent {
  std::vector<Index> nodes;  ///< the ground is one of them
  Rotations rotations;       ///< world_from_i of each
  std::vector<RelativeQuaternion> measurements;
  Index ground;

  CoreOfComponent(const TendedCore& tended, const OnlineComponent& component)
      : ground(component.ground) {
    for (const Index i : component.nodes) {
      if (tended.core.node(i).kind == NodeKind::hanging) continue;
      nodes.push_back(i);
      rotations.push_back(tended.core.rotation(i).toRotationMatrix());
      for (const GrowingGraph::End& end : tended.graph().ends(i)) {
        const OnlineEdge& e = tended.graph().edge(end.edge);
        if (e.i != i || !e.in_core || !(e.weight > 0.0)) continue;
        measurements.push_back({e.i, e.j, e.i_from_j, e.weight});
      }
    }
  }

  MeasurementGraph graph() const {
    return MeasurementGraph(
        measurements.size(), [&](std::size_t k) { return measurements[k]; },
        std::vector<NodeId>(nodes.begin(), nodes.end()));
  }

  /// Takes other rotations of the nodes over, turned so that the ground stays as it is.
  /// @returns the nodes that are no ground; the objective of the component is to be summed anew
  std::vector<Index> place(TendedCore& tended, const Rotations& R) const {
    Quaternion turn = Quaternion::Identity();
    for (std::size_t a = 0; a < nodes.size(); ++a) {
      if (nodes[a] != ground) continue;
      turn = Quaternion(product(tended.core.node(ground).q, to_quaternion(R[a]).conjugate()));
    }
    for (std::size_t a = 0; a < nodes.size(); ++a) {
      if (nodes[a] == ground) continue;
      tended.core.node(nodes[a]).q = Quaternion(product(turn, to_quaternion(R[a]))).normalized();
    }
    for (const Index i : nodes) {
      for (const GrowingGraph::End& end : tended.graph().ends(i)) {
        const OnlineEdge& e = tended.graph().edge(end.edge);
        if (e.i == i && e.in_core && e.weight > 0.0) tended.update_edge(end.edge);
      }
    }
    std::vector<Index> others;
    for (const Index i : nodes) {
      if (tended.core.node(i).kind != NodeKind::core) continue;
      tended.update_node(i);
      others.push_back(i);
    }
    return others;
  }
};

}  // namespace rotavg

#pragma GCC diagnostic pop

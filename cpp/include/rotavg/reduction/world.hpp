#pragma once

#include <vector>

#include <rotavg/reduction/checked_priors.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/reduction/riding.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How far what is known exactly may contradict itself, by the rounding of files; radians.
constexpr double max_contradiction = 1e-6;

/// Frames that a fixed node holds ride on the world, which is variable 0; all others on themselves.
/// Of several fixed cameras of a frame the first holds it.
/// @param frames what the nodes ride on
/// @throws InvalidPrior where the cameras of a rig are fixed to rotations that do not fit together
inline Riding ride_on_world(const Riding& frames, const std::vector<CheckedPriors::Rotation>& fixed,
                            const MeasurementGraph& graph) {
  Riding riding = Riding::alone(frames.num_variables);
  std::vector<bool> held(riding.variable.size(), false);
  for (const CheckedPriors::Rotation& p : fixed) {
    const Index frame = frames.variable[p.node];
    const Matrix3 world_from_frame =
        product_transposed(p.world_from_node, frames.variable_from_node[p.node]);
    Matrix3& known = riding.variable_from_node[frame];
    if (held[frame] && angle_between(known, world_from_frame) > max_contradiction) {
      throw InvalidPrior(PriorKind::fixed, graph.nodes()[p.node],
                         "does not fit the rig and another fixed camera of its frame");
    }
    if (!held[frame]) known = world_from_frame;
    held[frame] = true;
  }
  Index variables = 1;
  for (Index frame = 0; frame < frames.num_variables; ++frame) {
    riding.variable[frame] = held[frame] ? 0 : variables++;
  }
  riding.num_variables = variables;
  return riding;
}

/// Absolute priors and gravity as edges of the world: first the absolute ones, then every pair of
/// gravity. Those of nodes that ride on the world say nothing that can change.
/// @param pairs receives where gravity stands
/// @param first the row of the first of these edges
inline std::vector<RelativeRotation> edges_of_world(const CheckedPriors& priors,
                                                    const Riding& riding, Index first,
                                                    GravityPairs& pairs) {
  constexpr NodeId world = 0;
  std::vector<RelativeRotation> edges;
  for (const CheckedPriors::Rotation& p : priors.absolute) {
    const Index v = riding.variable[p.node];
    if (v == world) continue;
    edges.push_back({world, v,
                     product_transposed(p.world_from_node, riding.variable_from_node[p.node]),
                     p.weight});
  }
  pairs.down = priors.down;
  for (const CheckedPriors::Gravity& p : priors.gravity) {
    const Index v = riding.variable[p.node];
    if (v == world) continue;
    const Matrix3 Q =
        product(riding.variable_from_node[p.node], rotation_taking(priors.down, p.down));
    pairs.first.push_back(first + static_cast<Index>(edges.size()));
    edges.push_back({v, world, Q, p.weight});
    edges.push_back({v, world, product(Q, half_turn(priors.down)), p.weight});
  }
  return edges;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

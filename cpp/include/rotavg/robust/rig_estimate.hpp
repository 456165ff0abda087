#pragma once

#include <optional>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// What is known of rigs in the end.
struct RigEstimate {
  std::vector<NodeId> sensors;       ///< in the order of their first nodes
  Rotations frame_from_sensor;       ///< C of every sensor
  std::vector<SensorOrigin> origin;  ///< where it comes from
  /// Whether the measurements tell it: false where the objective does not rise in some direction
  /// from it, as of a sensor whose images no edge joins to others, on a trajectory that turns about
  /// one axis only.
  std::vector<bool> determined;
  Rotations rotations;  ///< (n,) world_from_node, where frames and sensors ended together
  bool converged = false;
  int iterations = 0;              ///< of frames and sensors together
  double relative_gradient = 0.0;  ///< over frames and sensors, the larger
  double seconds = 0.0;
  /// No frames and sensors have a smaller objective than this (with the weights of the solution):
  /// what is proved of images of unknown sensors as plain nodes. Only of solve_rigs(), and where
  /// something was estimated and a certificate asked for.
  std::optional<double> lower_bound;

  /// Priors with the rigs, all sensors held where they are.
  /// @param other what else is known; its rigs do not count
  Priors held(const MeasurementGraph& graph, const Rigs& rigs, const Priors& other = {}) const {
    return RigLayout(graph, rigs).held(graph, other, frame_from_sensor);
  }
};

}  // namespace rotavg

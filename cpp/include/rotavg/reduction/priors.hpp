#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// R_i is held at this rotation.
struct FixedRotation {
  NodeId node = 0;
  Matrix3 world_from_node = Matrix3::Identity();
};

/// w |R_i - P|_F^2 is added to the objective, as an edge of weight w from the world would add.
struct AbsolutePrior {
  NodeId node = 0;
  Matrix3 world_from_node = Matrix3::Identity();  ///< P
  double weight = 1.0;                            ///< w
};

/// 2 w |R_i d - g|^2 is added to the objective, so that a tilt counts as the angle of an edge of
/// weight w does. Only the heading stays free.
struct GravityPrior {
  NodeId node = 0;
  Vector3 down = Vector3::UnitY();  ///< d, in the frame of the node, of any length
  double weight = 1.0;              ///< w
};

/// A camera of a calibrated rig: R_i = Q_f C with Q_f the rotation of the frame, which all cameras
/// with the same `frame` share.
struct RigCamera {
  NodeId node = 0;
  NodeId frame = 0;                               ///< any number; need not be that of a node
  Matrix3 frame_from_node = Matrix3::Identity();  ///< C
};

/// What is known beforehand of the rotations R_i = world_from_i. With any prior but a rig, the
/// world is no free gauge.
struct Priors {
  std::vector<FixedRotation> fixed;
  std::vector<AbsolutePrior> absolute;
  std::vector<GravityPrior> gravity;
  std::vector<RigCamera> rigs;
  Vector3 down = Vector3::UnitY();  ///< g, down in the world, of any length

  /// Whether there is something that the world is held by.
  bool hold_world() const { return !fixed.empty() || !absolute.empty() || !gravity.empty(); }
  bool empty() const { return !hold_world() && rigs.empty(); }
};

enum class PriorKind { fixed, absolute, gravity, rig, sensor, down };

/// A prior that no problem can hold: which one and why.
class InvalidPrior : public std::invalid_argument {
 public:
  InvalidPrior(PriorKind kind, NodeId node, const std::string& reason)
      : std::invalid_argument(subject(kind, node) + " " + reason),
        kind_(kind),
        node_(node),
        reason_(reason) {}
  PriorKind kind() const { return kind_; }
  /// Of PriorKind::sensor that of the sensor; means nothing for PriorKind::down.
  NodeId node() const { return node_; }
  const std::string& reason() const { return reason_; }

 private:
  static std::string subject(PriorKind kind, NodeId node) {
    static constexpr const char* names[] = {"fixed", "absolute", "gravity", "rig"};
    if (kind == PriorKind::down) return "down";
    if (kind == PriorKind::sensor) return "the rotation of sensor " + std::to_string(node);
    return std::string("the ") + names[static_cast<int>(kind)] + " prior of node " +
           std::to_string(node);
  }

  PriorKind kind_;
  NodeId node_;
  std::string reason_;
};

}  // namespace rotavg

#pragma once

#include <vector>

#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The edges of a graph that are gravity: each of these, from a node to the world, and the next
/// one.
struct GravityPairs {
  std::vector<Index> first;         ///< edges, rising
  Vector3 down = Vector3::UnitY();  ///< g, of length 1
  /// Labels (nodes of the graph,) of the parts that gravity alone holds, so that their heading is
  /// free; others have -1. Empty where there are none.
  std::vector<Index> free_heading;

  /// What a pair costs at any rotation, 8 w.
  /// @param e residual quaternion of its first edge
  static double constant(const Eigen::Vector4d& e) { return 8.0 * e.squaredNorm(); }
  /// What the pair costs besides. The residual quaternion of the second edge is that of the first,
  /// e = (v, s), times a half turn about g: |v'|^2 = s^2 + |v|^2 - (v . g)^2, so that
  /// 8 |v|^2 + 8 |v'|^2 - 8 w = 8 |v x g|^2.
  double cost(const Eigen::Vector4d& e) const {
    const Vector3 across = cross({e.x(), e.y(), e.z()}, down);
    return 8.0 * dot(across, across);
  }
};

}  // namespace rotavg

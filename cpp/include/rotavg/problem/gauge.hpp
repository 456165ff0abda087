#pragma once

#include <rotavg/graph/components.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Turns every component as a whole so that its first node has R = I. The objective does not
/// change.
inline void fix_gauge(const Components& components, Rotations& R) {
  for (const auto& nodes : components.nodes) {
    const Matrix3 root_from_world = R[nodes.front()].transpose();
    for (const Index i : nodes) {
      R[i] = root_from_world * R[i];
    }
    R[nodes.front()].setIdentity();
  }
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <map>
#include <vector>

#include <rotavg/reduction/checked_priors.hpp>
#include <rotavg/reduction/riding.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Every camera of a calibrated rig rides on its frame, every other node on itself. Variables are
/// numbered in the order of their first nodes.
inline Riding ride_on_frames(Index num_nodes, const std::vector<CheckedPriors::Rig>& rigs) {
  Riding riding = Riding::alone(num_nodes);
  if (rigs.empty()) return riding;
  std::map<NodeId, Index> variable_of_frame;
  riding.num_variables = 0;
  auto rig = rigs.begin();  // in the order of their nodes
  for (Index i = 0; i < num_nodes; ++i) {
    Index v = riding.num_variables;
    if (rig != rigs.end() && rig->node == i) {
      v = variable_of_frame.emplace(rig->frame, v).first->second;
      riding.variable_from_node[i] = rig->frame_from_node;
      ++rig;
    }
    riding.variable[i] = v;
    if (v == riding.num_variables) ++riding.num_variables;
  }
  return riding;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

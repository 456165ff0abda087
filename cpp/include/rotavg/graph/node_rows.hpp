#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// Finds the row of a node by its id.
class NodeRows {
 public:
  /// @throws std::invalid_argument if an id stands twice
  explicit NodeRows(const std::vector<NodeId>& nodes)
      : first_(nodes.empty() ? 0 : nodes.front()), count_(nodes.size()) {
    std::size_t k = 0;
    while (k < count_ && from_first(nodes[k]) == k) ++k;
    if (k == count_) return;  // they count up: there is nothing to look for
    sorted_.reserve(nodes.size());
    for (const NodeId id : nodes) sorted_.emplace_back(id, static_cast<Index>(sorted_.size()));
    std::sort(sorted_.begin(), sorted_.end());
    const auto twice =
        std::adjacent_find(sorted_.begin(), sorted_.end(),
                           [](const auto& a, const auto& b) { return a.first == b.first; });
    if (twice != sorted_.end()) {
      throw std::invalid_argument("node " + std::to_string(twice->first) +
                                  " stands twice in the list of nodes");
    }
  }

  /// The row of a node, or -1 if there is none of this id.
  Index find(NodeId id) const {
    if (sorted_.empty()) {
      const std::uint64_t row = from_first(id);
      return row < count_ ? static_cast<Index>(row) : -1;
    }
    const auto at = std::lower_bound(sorted_.begin(), sorted_.end(), std::make_pair(id, Index{0}));
    return at != sorted_.end() && at->first == id ? at->second : -1;
  }

 private:
  /// How far behind the first, in numbers that wrap around.
  std::uint64_t from_first(NodeId id) const {
    return static_cast<std::uint64_t>(id) - static_cast<std::uint64_t>(first_);
  }

  NodeId first_;
  std::size_t count_;
  std::vector<std::pair<NodeId, Index>> sorted_;  ///< empty where the ids count up
};

}  // namespace rotavg

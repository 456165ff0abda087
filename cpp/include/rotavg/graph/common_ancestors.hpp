#pragma once

#include <utility>
#include <vector>

#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The lowest common ancestors of nodes of a forest, each in O(log n) steps: beside its parent a
/// node knows one ancestor further up, at distances that grow as skew-binary numbers do (Myers
/// 1983).
class CommonAncestors {
 public:
  /// @param parent (n,) of every node, a root's is -1; must outlive this object
  /// @param order of the nodes, parents first
  CommonAncestors(const std::vector<Index>& parent, const std::vector<Index>& order)
      : parent_(parent), depth_(parent.size(), 0), jump_(parent.size()) {
    for (const Index v : order) {
      const Index p = parent[v];
      jump_[v] = v;
      if (p < 0) continue;
      depth_[v] = depth_[p] + 1;
      const Index far = jump_[jump_[p]];
      jump_[v] = depth_[p] - depth_[jump_[p]] == depth_[jump_[p]] - depth_[far] ? far : p;
    }
  }

  Index depth(Index v) const { return depth_[v]; }
  /// -1 where a and b are of two trees.
  Index operator()(Index a, Index b) const {
    if (depth_[a] < depth_[b]) std::swap(a, b);
    while (depth_[a] > depth_[b]) a = depth_[jump_[a]] >= depth_[b] ? jump_[a] : parent_[a];
    while (a != b) {
      if (parent_[a] < 0) return -1;
      const bool jumps = jump_[a] != jump_[b];
      a = jumps ? jump_[a] : parent_[a];
      b = jumps ? jump_[b] : parent_[b];
    }
    return a;
  }

 private:
  const std::vector<Index>& parent_;
  std::vector<Index> depth_, jump_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Neighbouring columns of a Cholesky factor L with (nearly) the same rows.
struct Supernode {
  Index begin = 0, end = 0;      ///< columns
  Index parent = -1;             ///< supernode, -1 for a root
  Index first = 0;               ///< supernode: with it begins the subtree that ends here
  std::vector<Index> below;      ///< further rows, rising
  std::vector<Index> in_parent;  ///< where these stand among the parent's rows

  Index columns() const { return end - begin; }
  Index num_below() const { return static_cast<Index>(below.size()); }
  std::size_t rows() const { return below.size() + (end - begin); }
  /// Multiplications of its elimination, about, with blocks of size one.
  double work() const {
    const double pivots = columns(), others = num_below();
    return pivots * (pivots * pivots / 6.0 + 0.5 * (pivots + others) * (others + 1.0));
  }
};

/// Calls f with the children of supernode s, the last first: in postorder, which these stand in,
/// the subtrees of the children stand before it.
template <typename Function>
void for_each_child(const std::vector<Supernode>& supernodes, Index s, Function&& f) {
  for (Index c = s - 1; c >= supernodes[s].first; c = supernodes[c].first - 1) f(c);
}

/// Children before parents, subtree by subtree.
inline std::vector<Index> postorder(const std::vector<Index>& parent) {
  const auto n = static_cast<Index>(parent.size());
  std::vector<Index> first_child(static_cast<std::size_t>(n), -1), sibling(first_child);
  for (Index k = n - 1; k >= 0; --k) {
    if (parent[k] >= 0) sibling[k] = std::exchange(first_child[parent[k]], k);
  }
  std::vector<Index> order, stack;
  order.reserve(static_cast<std::size_t>(n));
  for (Index root = 0; root < n; ++root) {
    if (parent[root] >= 0) continue;
    stack.push_back(root);
    while (!stack.empty()) {
      const Index k = stack.back();
      if (first_child[k] >= 0) {
        stack.push_back(std::exchange(first_child[k], -1));
        continue;
      }
      stack.pop_back();
      order.push_back(k);
      if (sibling[k] >= 0) stack.push_back(sibling[k]);
    }
  }
  return order;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include <rotavg/robust/comparison.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The edges between two groups of cameras that two answers place differently.
struct Bundle {
  Index group = 0, other_group = 0;  ///< of Alternative::group
  Index edges = 0;                   ///< that the answer explains, and the alternative does not
  double weight = 0.0;               ///< theirs together
  Index alternative_edges = 0;       ///< the other way round
  double alternative_weight = 0.0;
};

/// Another answer that explains the graph, too.
struct Alternative {
  Rotations rotations;  ///< world_from_i, in the gauge of the answer
  std::vector<Index>
      group;            ///< (n,) groups that both answers share; 0 is the largest of a component
  Comparison evidence;  ///< of the answer against this one
  std::vector<Bundle> bundles;  ///< the heaviest first
  double closure = 0.0;         ///< Evidence::closure of the edges that only this one explains
  double answer_closure = 0.0;  ///< and of those that only the answer explains
  /// Some of the pairs that ought to match if this were true and do not.
  std::vector<std::pair<Index, Index>> missing;

  /// How many cameras are not in the largest group.
  Index num_different() const {
    return static_cast<Index>(group.size()) -
           static_cast<Index>(std::count(group.begin(), group.end(), 0));
  }
};

}  // namespace rotavg

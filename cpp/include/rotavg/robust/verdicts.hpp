#pragma once

#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// What a robust solution says of an edge. All from robust_weight on are outliers.
enum class EdgeVerdict {
  inlier,
  bridge,         ///< no cycle passes through it: nothing checks it
  trusted,        ///< the caller's: the loss does not touch it
  robust_weight,  ///< its residual is beyond the threshold
  cycle_check,    ///< no short cycle agrees with it: it was left out from the start
  weak_part,      ///< beyond the threshold as well; and no inlier joins the same two parts
  excluded,       ///< the caller's: it was left out from the start
};

inline bool is_outlier(EdgeVerdict verdict) { return verdict >= EdgeVerdict::robust_weight; }

struct EdgeVerdicts {
  std::vector<EdgeVerdict> edges;  ///< (m,)
  /// (n,) the parts that edges which are no outliers hold together. Where a component has more than
  /// one, the rotations of its parts relative to each other rest on distrusted edges alone.
  std::vector<Index> part;
};

}  // namespace rotavg

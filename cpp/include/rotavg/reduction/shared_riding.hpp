#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/reduction/riding.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Nodes that ride on variables with constant rotations and, some of them, with rotations that
/// several share and nobody knows:
///
///     R_i = Q_v(i) K_i C_s(i).
struct SharedRiding {
  Riding riding;              ///< v(i) and K_i
  std::vector<Index> shared;  ///< (n,) s(i); -1: C = I
  Index num_shared = 0;

  Rotations nodes_from(const Rotations& Q, const Rotations& C) const {
    Rotations R = riding.nodes_from(Q);
    for (std::size_t i = 0; i < R.size(); ++i) {
      if (shared[i] >= 0) R[i] = R[i] * C[shared[i]];
    }
    return R;
  }
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>

#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

namespace rotavg::test {

/// The largest angle between two sets of rotations after those of node 0 were laid on each other.
inline double largest_error(const Rotations& R, const Rotations& truth) {
  const Matrix3 gauge = truth[0] * R[0].transpose();
  double largest = 0.0;
  for (std::size_t i = 0; i < R.size(); ++i) {
    largest = std::max(largest, angle_between(gauge * R[i], truth[i]));
  }
  return largest;
}

}  // namespace rotavg::test

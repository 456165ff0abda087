#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#include "random.hpp"

namespace rotavg::test {

/// Cameras on a ring about a thing with two like sides: each matches its nearest neighbours on
/// either side, with fewer matches the farther they are, and with half as many matches, and less,
/// the ones that see the other side as it does. Those edges say that both are turned alike.
struct Folded {
  std::vector<RelativeRotation> measurements;
  Rotations truth;
};

inline Folded folded_ring(Random& random, Index n, double noise, Index nearest, Index alike) {
  constexpr double two_pi = 6.283185307179586;
  Folded ring;
  for (Index i = 0; i < n; ++i) {
    ring.truth.push_back(exp_so3(Vector3(0.0, 0.0, two_pi * i / n)));
  }
  const Matrix3 half_turn = exp_so3(Vector3(0.0, 0.0, two_pi / 2.0));
  const auto add = [&](Index i, Index j, const Matrix3& turn, double weight) {
    RelativeRotation m;
    m.i = std::min(i, j);
    m.j = std::max(i, j);
    m.i_from_j = ring.truth[m.i].transpose() * turn * ring.truth[m.j] *
                 exp_so3(noise * random.normal_vector());
    m.weight = weight;
    ring.measurements.push_back(m);
  };
  for (Index i = 0; i < n; ++i) {
    for (Index step = 1; step <= nearest; ++step) {
      add(i, (i + step) % n, Matrix3::Identity(), 400.0 / step);
    }
    if (i >= n / 2) continue;
    for (Index step = -alike; step <= alike; ++step) {
      add(i, (i + n / 2 + step + n) % n, half_turn, 60.0 / (1 + std::abs(step)));
    }
  }
  return ring;
}

}  // namespace rotavg::test

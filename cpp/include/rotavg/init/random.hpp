#pragma once

#include <cstdint>
#include <random>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A uniformly random rotation for every node: the same ones for the same seed.
inline Rotations random_init(const MeasurementGraph& graph, std::uint64_t seed) {
  std::mt19937_64 generator(seed);
  Rotations R(graph.num_nodes());
  for (Matrix3& R_i : R) R_i = random_rotation(generator);
  return R;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

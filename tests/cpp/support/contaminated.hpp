#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#include "graphs.hpp"
#include "random.hpp"

namespace rotavg::test {

struct Contaminated {
  MeasurementGraph graph;
  Rotations truth;
  std::vector<bool> is_wrong;
};

/// Measurements of random rotations, a share of them random instead.
inline Contaminated contaminated(Random& random, const Pairs& pairs, double noise, double share) {
  const Rotations truth = random.rotations(num_nodes(pairs));
  auto measurements = measure(random, pairs, truth, noise);
  std::vector<bool> is_wrong(measurements.size(), false);
  for (std::size_t k = 0; k < measurements.size(); ++k) {
    if (random.uniform(0.0, 1.0) >= share) continue;
    measurements[k].i_from_j = random.rotation();
    is_wrong[k] = true;
  }
  return {MeasurementGraph(measurements), truth, is_wrong};
}

}  // namespace rotavg::test

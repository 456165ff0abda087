#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#include "random.hpp"

namespace rotavg::test {

/// Which nodes, 0 … n-1, are joined.
using Pairs = std::vector<std::pair<Index, Index>>;

inline Pairs complete(Index n) {
  Pairs pairs;
  for (Index i = 0; i < n; ++i) {
    for (Index j = i + 1; j < n; ++j) pairs.emplace_back(i, j);
  }
  return pairs;
}

inline Pairs path(Index n) {
  Pairs pairs;
  for (Index i = 0; i + 1 < n; ++i) pairs.emplace_back(i, i + 1);
  return pairs;
}

inline Pairs cycle(Index n) {
  Pairs pairs = path(n);
  pairs.emplace_back(n - 1, 0);
  return pairs;
}

/// Bipartite: undamped simultaneous steps on it may swing between two values for ever.
inline Pairs grid(Index rows, Index columns) {
  Pairs pairs;
  for (Index r = 0; r < rows; ++r) {
    for (Index c = 0; c < columns; ++c) {
      const Index i = r * columns + c;
      if (c + 1 < columns) pairs.emplace_back(i, i + 1);
      if (r + 1 < rows) pairs.emplace_back(i, i + columns);
    }
  }
  return pairs;
}

/// A random tree and `extra` more edges, parallel ones possible, each in a random direction.
inline Pairs random_connected(Random& random, Index n, Index extra) {
  Pairs pairs;
  for (Index i = 1; i < n; ++i) pairs.emplace_back(random.below(i), i);
  for (Index k = 0; k < extra; ++k) {
    const Index i = random.below(n);
    pairs.emplace_back(i, (i + 1 + random.below(n - 1)) % n);
  }
  for (auto& [i, j] : pairs) {
    if (random.coin()) std::swap(i, j);
  }
  return pairs;
}

/// R_ij = R_i^T R_j exp(e), e with a uniform axis and an angle of standard deviation `noise`.
inline std::vector<RelativeRotation> measure(Random& random, const Pairs& pairs,
                                             const Rotations& truth, double noise) {
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : pairs) {
    const double angle = noise > 0.0 ? noise * random.normal() : 0.0;
    const Matrix3 error = exp_so3(angle * random.direction());
    measurements.push_back({i, j, truth[i].transpose() * truth[j] * error, 1.0});
  }
  return measurements;
}

inline Index num_nodes(const Pairs& pairs) {
  Index n = 0;
  for (const auto& [i, j] : pairs) n = std::max({n, i + 1, j + 1});
  return n;
}

/// Measurements of random rotations.
inline std::vector<RelativeRotation> simulate(Random& random, const Pairs& pairs, double noise) {
  return measure(random, pairs, random.rotations(num_nodes(pairs)), noise);
}

inline MeasurementGraph simulate_graph(Random& random, const Pairs& pairs, double noise) {
  return MeasurementGraph(simulate(random, pairs, noise));
}

/// Weights spread over 10^-decades … 10^decades.
inline void spread_weights(Random& random, double decades,
                           std::vector<RelativeRotation>& measurements) {
  for (RelativeRotation& m : measurements) m.weight = random.power_of_ten(-decades, decades);
}

/// The paper's synthetic graph: complete, a fraction of its edges dropped, still connected.
inline MeasurementGraph paper_graph(Random& random, Index n, double noise, double dropped) {
  const auto measurements = simulate(random, complete(n), noise);
  std::vector<NodeId> nodes;
  for (Index i = 0; i < n; ++i) nodes.push_back(i);
  for (;;) {
    auto kept = measurements;
    for (auto left = static_cast<Index>(dropped * static_cast<double>(kept.size())); left > 0;
         --left) {
      kept.erase(kept.begin() + random.below(static_cast<Index>(kept.size())));
    }
    const MeasurementGraph graph(kept, nodes);
    if (connected_components(graph).size() == 1) return graph;
  }
}

/// A noiseless cycle: identity measurements. Node k of its twisted stationary point is turned by
/// 2 pi k turns / n about z; every edge then leaves the same angle over.
inline MeasurementGraph noiseless_cycle(Index n) {
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : cycle(n)) measurements.push_back({i, j});
  return MeasurementGraph(measurements);
}

inline Rotations twisted(Index n, int turns) {
  constexpr double two_pi = 6.283185307179586;
  Rotations R;
  for (Index k = 0; k < n; ++k) R.push_back(exp_so3({0.0, 0.0, two_pi * turns * k / n}));
  return R;
}

/// Every rotation moved by a random angle of about `size`.
inline Rotations perturbed(Random& random, Rotations R, double size) {
  for (Matrix3& R_i : R) R_i = exp_so3(size * random.normal_vector()) * R_i;
  return R;
}

/// Up to 12 nodes and few edges: several components, isolated nodes and parallel edges.
inline MeasurementGraph scattered_graph(Random& random) {
  const Index n = 2 + random.below(11);
  Pairs pairs;
  for (Index k = 1 + random.below(n); k > 0; --k) {
    const Index i = random.below(n);
    pairs.emplace_back(i, (i + 1 + random.below(n - 1)) % n);
  }
  auto measurements = measure(random, pairs, random.rotations(n), 1.0);
  spread_weights(random, 1.0, measurements);
  std::vector<NodeId> nodes;
  for (NodeId id = 0; id < n; ++id) nodes.push_back(id);
  return MeasurementGraph(measurements, nodes);
}

}  // namespace rotavg::test

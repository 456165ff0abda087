#pragma once

#include <utility>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/types.hpp>

#include "graphs.hpp"
#include "random.hpp"

// What the tests of certificates share: points to certify, and the ways to do it.

namespace rotavg::test {

/// A stationary point, to rounding: not always the global optimum.
inline Rotations descend(const MeasurementGraph& graph, Rotations start) {
  IterationOptions options;
  options.tolerance = 1e-13;
  options.max_iterations = 5000;
  return bcd(graph, std::move(start), options).rotations;
}

inline MeasurementGraph small_graph(Random& random, double noise) {
  const Index n = 2 + random.below(9);
  auto measurements = simulate(random, random_connected(random, n, 2 * n), noise);
  spread_weights(random, random.coin() ? 0.0 : 1.0, measurements);
  return MeasurementGraph(measurements);
}

inline CertificateOptions by_random_start() {
  CertificateOptions options;
  options.max_factorization_flops = 0.0;
  return options;
}

inline CertificateOptions by_eigenvalue() {
  CertificateOptions options = by_random_start();
  options.failure_probability = 0.0;
  return options;
}

}  // namespace rotavg::test

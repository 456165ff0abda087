#include <algorithm>
#include <cmath>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/connectivity.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// What the two proofs without a factorisation of S say at R.
struct Bounds {
  Bounds(const MeasurementGraph& graph, const Rotations& R) {
    const Components components = connected_components(graph);
    const ResidualQuaternions residuals(graph, to_quaternions(R), 1);
    const NodeSums sums(residuals);
    const CertificateMatrix S(sums, components, 0);
    connectivity = bound_by_connectivity(S, {});
    positive_eigenvalue = bound_by_positive_eigenvalue(S, {});
  }
  ComponentBound connectivity, positive_eigenvalue;
};

bool is_known(const ComponentBound& bound) { return bound.method != CertificateMethod::none; }

MeasurementGraph dense_graph(Random& random, Index n, double noise) {
  auto measurements = test::simulate(random, test::complete(n), noise);
  test::spread_weights(random, random.coin() ? 0.0 : 0.5, measurements);
  return MeasurementGraph(measurements);
}

}  // namespace

TEST_CASE("what the connectivity proves is true, at stationary points and elsewhere") {
  Random random;
  INFO(random.replay());
  int proofs = 0, refusals = 0;
  for (int trial = 0; trial < 200; ++trial) {
    CAPTURE(trial);
    const Index n = 5 + random.below(25);
    const MeasurementGraph graph = dense_graph(random, n, random.uniform(0.0, 0.8));
    const Solution optimum = solve(graph);
    if (optimum.certificate.verdict != Verdict::proved) continue;
    for (const double size : {0.0, 1e-6, 1e-2, 0.2}) {
      CAPTURE(size);
      const Rotations R =
          size > 0.0 ? test::perturbed(random, optimum.rotations, size) : optimum.rotations;
      const Bounds bounds(graph, R);
      const double f = objective(graph, R);
      const double eigenvalue =
          test::dense_eigenvalues(test::dense_certificate_matrix(graph, R))(0);
      for (const ComponentBound& bound : {bounds.connectivity, bounds.positive_eigenvalue}) {
        if (!is_known(bound)) {
          ++refusals;
          continue;
        }
        ++proofs;
        CHECK(f - bound.gap <= optimum.objective * (1.0 + 1e-12) + 1e-13 * graph.total_weight());
        CHECK(bound.lambda_min == doctest::Approx(eigenvalue).epsilon(1e-6).scale(1e-3 * n));
      }
    }
  }
  CHECK(proofs > 300);
  CHECK(refusals > 20);
}

TEST_CASE("the connectivity proves the paper's complete graphs of 20 nodes") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.2, 0.5}) {
    for (int trial = 0; trial < 10; ++trial) {
      const MeasurementGraph graph = test::simulate_graph(random, test::complete(20), noise);
      const Bounds bounds(graph, solve(graph).rotations);
      CAPTURE(noise);
      CHECK(is_known(bounds.connectivity));
      CHECK(bounds.connectivity.gap < 1e-8);
    }
  }
}

TEST_CASE("neither speaks for a stationary point that is not the optimum") {
  Random random;
  INFO(random.replay());
  for (const Index n : {8, 20, 50}) {
    const MeasurementGraph ring = test::noiseless_cycle(n);
    const Bounds bounds(ring, test::twisted(n, 1));
    CHECK_FALSE(is_known(bounds.connectivity));
    CHECK_FALSE(is_known(bounds.positive_eigenvalue));
  }
  // Local minima of noisy sparse graphs.
  int others = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Index n = 15 + random.below(15);
    const MeasurementGraph graph =
        test::simulate_graph(random, test::random_connected(random, n, n / 2), 0.3);
    const Solution optimum = solve(graph);
    IterationOptions options;
    options.tolerance = 1e-13;
    const IterationResult end = bcd(graph, random.rotations(n), options);
    if (!(end.objective > optimum.objective * 1.01)) continue;
    ++others;
    const Bounds bounds(graph, end.rotations);
    CHECK_FALSE(is_known(bounds.connectivity));
    CHECK_FALSE(is_known(bounds.positive_eigenvalue));
  }
  CHECK(others > 5);
}

#include <algorithm>
#include <cmath>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/connectivity.hpp>
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

/// What the proofs without a factorisation of S say at R.
struct Bounds {
  Bounds(const MeasurementGraph& graph, const Rotations& R) {
    const Components components = connected_components(graph);
    const ResidualQuaternions residuals(graph, to_quaternions(R), 1);
    const NodeSums sums(residuals);
    const CertificateMatrix S(sums, components, 0);
    connectivity = Connectivity(S).bound_by_factorization({});
    norm = Connectivity(S).bound_by_norm({});
  }
  ComponentBound connectivity, norm;
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
      // What the norm proves the factorisation proves, too.
      if (is_known(bounds.norm)) CHECK(is_known(bounds.connectivity));
      for (const ComponentBound& bound : {bounds.connectivity, bounds.norm}) {
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
  CHECK(proofs > 400);
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
      for (const ComponentBound& bound : {bounds.connectivity, bounds.norm}) {
        CHECK(is_known(bound));
        CHECK(bound.gap < 1e-8);
      }
    }
  }
}

TEST_CASE("the norm is that of D^-1/2 (A - c 1 1^T) D^-1/2, parallel edges as one") {
  // Complete, all edges double: with A = 2 (1 1^T - I) and c its mean, the norm is a closed form,
  // and grows past one as the noiseless rotations are turned away from each other.
  Random random;
  INFO(random.replay());
  constexpr Index n = 12;
  auto measurements = test::simulate(random, test::complete(n), 0.0);
  measurements.insert(measurements.end(), measurements.begin(), measurements.end());
  const MeasurementGraph graph(measurements);
  const Rotations optimum = solve(graph).rotations;
  int proofs = 0, refusals = 0;
  for (double angle = 0.0; angle < 1.0; angle += 0.02) {
    // One node turned: its edges have this residual, and every other node has two such edges.
    Rotations R = optimum;
    R[n - 1] = exp_so3({angle, 0.0, 0.0}) * R[n - 1];
    const double chord = 2.0 * std::sin(0.5 * angle), lost = 2.0 * (1.0 - std::cos(angle));
    const double degree = 2.0 * (n - 1), l = 0.01 * degree;
    const double other = degree - 2.0 * chord - lost - l;  // D of the others, and of the turned one
    const double turned = degree - (n - 1) * (2.0 * chord + lost) - l;
    const double T = (n - 1) / other + 1.0 / turned;
    const double TT = (n - 1) / (other * other) + 1.0 / (turned * turned);
    const double square = 4.0 * (T * T - TT) - 4.0 * std::pow(T * T - TT, 2) / (T * T);
    if (std::abs(square - 0.99) < 1e-6 || std::abs(turned) < 1e-6) continue;
    const bool provable = turned > 0.0 && square < 0.99;
    CAPTURE(angle);
    CHECK(is_known(Bounds(graph, R).norm) == provable);
    ++(provable ? proofs : refusals);
  }
  CHECK(proofs > 5);
  CHECK(refusals > 5);
}

TEST_CASE("none speaks for a stationary point that is not the optimum") {
  Random random;
  INFO(random.replay());
  for (const Index n : {8, 20, 50}) {
    const MeasurementGraph ring = test::noiseless_cycle(n);
    const Bounds bounds(ring, test::twisted(n, 1));
    CHECK_FALSE(is_known(bounds.connectivity));
    CHECK_FALSE(is_known(bounds.norm));
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
    CHECK_FALSE(is_known(bounds.norm));
  }
  CHECK(others > 5);
}

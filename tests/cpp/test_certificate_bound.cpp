// The bound of a certificate: against dense eigenvalues, and against the best rotations known.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>

#include "support/certificates.hpp"
#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::by_eigenvalue;
using rotavg::test::by_random_start;
using rotavg::test::descend;
using rotavg::test::Random;
using rotavg::test::small_graph;

namespace {

constexpr double pi = 3.141592653589793;

/// The smallest objective that several starts lead to: at least f*.
double best_objective(Random& random, const MeasurementGraph& graph) {
  double best = objective(graph, descend(graph, shortest_path_init(graph)));
  for (int k = 0; k < 5; ++k) {
    const Rotations R = descend(graph, random.rotations(graph.num_nodes()));
    best = std::min(best, objective(graph, R));
  }
  return best;
}

double max_degree(const MeasurementGraph& graph) {
  double largest = 0.0;
  for (Index i = 0; i < graph.num_nodes(); ++i) largest = std::max(largest, graph.degree(i));
  return largest;
}

double dense_lambda_min(const MeasurementGraph& graph, const Rotations& R) {
  return test::dense_eigenvalues(test::dense_certificate_matrix(graph, R))(0);
}

}  // namespace

TEST_CASE("at stationary points the verdict and lambda_min are those of a dense decomposition") {
  Random random;
  INFO(random.replay());
  int optima = 0, others = 0;
  for (int k = 0; k < 100; ++k) {
    // Much noise makes local minima that are not global, and so does a twist of a cycle.
    const bool is_cycle = k % 2 == 0;
    const Index n = 10 + random.below(11);
    const auto identities = Rotations(static_cast<std::size_t>(n), Matrix3::Identity());
    const MeasurementGraph graph =
        is_cycle ? MeasurementGraph(test::measure(random, test::cycle(n), identities, 0.1))
                 : small_graph(random, random.uniform(0.1, 1.5));
    const Rotations R = descend(graph, is_cycle ? test::twisted(n, random.below(3) - 1)
                                                : random.rotations(graph.num_nodes()));
    if (gradient_norm(graph, R).relative > 1e-12) continue;  // a slow descent
    const double expected = dense_lambda_min(graph, R);
    const double degree = max_degree(graph);
    const bool optimal = expected > -1e-10 * degree;
    if (!optimal && expected > -1e-5 * degree) continue;  // too close to call
    (optimal ? optima : others)++;

    const Certificate certificate = certify(graph, R);
    CAPTURE(k);
    CAPTURE(expected);
    CAPTURE(certificate.gap);
    REQUIRE(certificate.method == CertificateMethod::factorization);
    REQUIRE(certificate.verdict == (optimal ? Verdict::proved : Verdict::not_certified));
    REQUIRE(std::abs(certificate.lambda_min - expected) < 1e-9 * degree);
    const double negative = -expected - 1e-13 * degree;  // but for the rounding of `expected`
    REQUIRE(certificate.gap >=
            std::min(objective(graph, R), negative * 3.0 * graph.num_nodes()) * (1.0 - 1e-9));

    const Certificate estimate = certify(graph, R, by_eigenvalue());
    REQUIRE(estimate.method == CertificateMethod::eigenvalue);
    REQUIRE((estimate.verdict == Verdict::not_certified) == !optimal);
    REQUIRE(std::abs(estimate.lambda_min - expected) < 1e-3 * degree);
  }
  CHECK(optima > 10);
  CHECK(others > 10);
}

TEST_CASE("away from stationary points lambda_min is still that of the symmetrised S") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = small_graph(random, 0.2);
    const double size = random.power_of_ten(-8, 1);
    const Rotations R = test::perturbed(random, descend(graph, shortest_path_init(graph)), size);
    const double expected = dense_lambda_min(graph, R);
    CAPTURE(size);
    REQUIRE(std::abs(certify(graph, R).lambda_min - expected) < 1e-8 * max_degree(graph));
  }
}

TEST_CASE("f(R) - gap never exceeds the best objective known, whatever R is") {
  Random random;
  INFO(random.replay());
  int useful = 0;
  for (int k = 0; k < 150; ++k) {
    const MeasurementGraph graph = small_graph(random, random.power_of_ten(-4, 0.3));
    const double best = best_objective(random, graph);
    const Rotations optimum = descend(graph, shortest_path_init(graph));
    for (const double size : {0.0, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0}) {
      const Rotations R = test::perturbed(random, optimum, size);
      const double f = objective(graph, R);
      CAPTURE(k);
      CAPTURE(size);
      const Certificate proof = certify(graph, R);
      REQUIRE(proof.gap >= 0.0);
      REQUIRE(f - proof.gap <= best + objective_rounding(graph, best));
      useful += proof.gap < 0.5 * f && size > 0.0 ? 1 : 0;
      for (const CertificateOptions& options : {by_eigenvalue(), by_random_start()}) {
        const Certificate other = certify(graph, R, options);
        REQUIRE(other.gap >= 0.0);
        REQUIRE(f - other.gap <= best + objective_rounding(graph, best));
      }
    }
  }
  CHECK(useful > 100);  // most gaps say more than f* >= 0
}

TEST_CASE("an edge that is off by any angle, at any weight, has the whole objective to gain") {
  Random random;
  INFO(random.replay());
  for (const double weight : {1e-6, 1e-3, 1.0, 1e3}) {
    for (const double degrees : {0.01, 1.0, 45.0, 89.0, 90.0, 91.0, 120.0, 179.0, 180.0}) {
      const MeasurementGraph graph({{0, 1, Matrix3::Identity(), weight}});
      const Rotations R = {Matrix3::Identity(), exp_so3(degrees * pi / 180.0 * random.direction())};
      const double f = objective(graph, R);
      CAPTURE(weight);
      CAPTURE(degrees);
      CHECK(certify(graph, R).gap >= f * (1.0 - 1e-12));
      CHECK(certify(graph, R, by_eigenvalue()).gap >= f * (1.0 - 1e-12));
      CHECK(certify(graph, R, by_random_start()).gap >= f * (1.0 - 1e-12));
    }
  }
}

TEST_CASE("near the optimum the gap is what is left to gain, not much more") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = simulate_graph(random, test::complete(8), 0.2);
    const Rotations optimum = descend(graph, shortest_path_init(graph));
    if (certify(graph, optimum).verdict != Verdict::proved) continue;
    const Rotations R = test::perturbed(random, optimum, 1e-3);
    const double left = objective(graph, R) - objective(graph, optimum);
    const double gap = certify(graph, R).gap;
    CAPTURE(left);
    CAPTURE(gap);
    REQUIRE(gap >= left * (1.0 - 1e-6));
    REQUIRE(gap <= left * 1.5);
  }
}

TEST_CASE("a gap that says less than the tolerance asks for is not called proved") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(10), 0.2);
  const Rotations optimum = descend(graph, shortest_path_init(graph));
  REQUIRE(certify(graph, optimum).verdict == Verdict::proved);
  const Rotations R = test::perturbed(random, optimum, 1e-2);
  const double left = (objective(graph, R) - objective(graph, optimum)) / objective(graph, R);
  CertificateOptions options;
  options.tolerance = 0.5 * left;
  CHECK(certify(graph, R, options).verdict == Verdict::not_certified);
  options.tolerance = 2.0 * left;
  CHECK(certify(graph, R, options).verdict == Verdict::proved);
  CHECK(certify(graph, R, options).relative_gap >= left);
}

TEST_CASE("weights that differ by many orders of magnitude do not bring a false proof") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 60; ++k) {
    const Index n = 3 + random.below(6);
    auto measurements = test::simulate(random, test::random_connected(random, n, 2 * n), 0.5);
    test::spread_weights(random, k < 30 ? 4.0 : 8.0, measurements);
    const MeasurementGraph graph(measurements);
    double best = std::numeric_limits<double>::infinity();
    std::vector<Rotations> points;
    for (int start = 0; start < 6; ++start) {
      points.push_back(descend(graph, random.rotations(n)));
      best = std::min(best, objective(graph, points.back()));
    }
    for (const Rotations& R : points) {
      const Certificate certificate = certify(graph, R);
      const double f = objective(graph, R);
      CAPTURE(k);
      REQUIRE(f - certificate.gap <= best + objective_rounding(graph, f));
    }
  }
}

TEST_CASE("an estimate says estimated where the factorisation says proved") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(30), 0.2);
  const Rotations R = descend(graph, shortest_path_init(graph));
  CHECK(certify(graph, R).verdict == Verdict::proved);
  const Certificate estimate = certify(graph, R, by_eigenvalue());
  CHECK(estimate.verdict == Verdict::estimated);
  CHECK(estimate.method == CertificateMethod::eigenvalue);
}

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;

/// The objective of the rotations that quaternions stand for, as certificates see it.
double quaternion_objective(const MeasurementGraph& graph, const Rotations& R) {
  return objective(graph, to_quaternions(R), 1);
}

/// Every node joined to some of the next ones.
test::Pairs band(Random& random, Index n, Index width, Index edges) {
  test::Pairs pairs = test::path(n);
  for (Index k = 0; k < edges; ++k) {
    const Index i = random.below(n - 1);
    pairs.emplace_back(i, std::min(n - 1, i + 1 + random.below(width)));
  }
  return pairs;
}

/// How many graphs: ROTAVG_TEST_GRAPHS, or so many.
int num_graphs(int usual) {
  const char* text = std::getenv("ROTAVG_TEST_GRAPHS");
  return text != nullptr && *text != '\0' ? std::atoi(text) : usual;
}

CertificateOptions by_random_start() {
  CertificateOptions options;
  options.max_factorization_flops = 0.0;
  return options;
}

}  // namespace

TEST_CASE("the optimum is proved at any noise, on any kind of graph") {
  Random random;
  INFO(random.replay());
  for (const double noise :
       {0.0, 1e-14, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1}) {
    const std::vector<test::Pairs> kinds = {test::cycle(300),
                                            test::complete(30),
                                            test::grid(15, 15),
                                            test::random_connected(random, 200, 300),
                                            test::random_connected(random, 200, 2500),
                                            band(random, 300, 20, 1200)};
    for (std::size_t kind = 0; kind < kinds.size(); ++kind) {
      const MeasurementGraph graph = simulate_graph(random, kinds[kind], noise);
      const Solution solution = solve(graph);
      CAPTURE(noise);
      CAPTURE(kind);
      CAPTURE(solution.certificate.relative_gap);
      CHECK(solution.certificate.verdict == Verdict::proved);
      CHECK(solution.certificate.failure_probability == 0.0);
      CHECK(solution.certificate.shortfall == Shortfall::none);
      // It takes what is measured, not rounding alone, to be proved: twice the noise is refuted.
      if (noise < 1e-9) continue;
      const Rotations R = test::perturbed(random, solution.rotations, noise);
      const Certificate away = certify(graph, R);
      CHECK(away.verdict == Verdict::not_certified);
      CHECK(away.gap >= (quaternion_objective(graph, R) - solution.objective) * (1.0 - 1e-3));
    }
  }
}

TEST_CASE("the optimum is proved where weights lie far apart") {
  Random random;
  INFO(random.replay());
  for (const double decades : {1.0, 2.0, 3.0, 6.0}) {
    for (int trial = 0; trial < 10; ++trial) {
      const Index n = 4 + random.below(40);
      auto measurements = test::simulate(random, test::random_connected(random, n, 3 * n), 0.02);
      test::spread_weights(random, decades, measurements);
      const Solution solution = solve(MeasurementGraph(measurements));
      CAPTURE(decades);
      CAPTURE(n);
      CAPTURE(solution.certificate.relative_gap);
      CHECK(solution.certificate.verdict == Verdict::proved);
    }
  }
  // As a robust loss leaves them: most edges agree to rounding, a few have next to no weight.
  for (const double weight : {1e-6, 1e-9, 1e-12}) {
    for (const double noise : {1e-12, 1e-7, 1e-2}) {
      auto measurements = test::simulate(random, test::complete(8), noise);
      for (int k = 0; k < 3; ++k) {
        measurements[random.below(28)] = {0, 1 + random.below(7), random.rotation(), weight};
      }
      const Solution solution = solve(MeasurementGraph(measurements));
      CAPTURE(weight);
      CAPTURE(noise);
      CAPTURE(solution.certificate.relative_gap);
      CHECK(solution.certificate.verdict == Verdict::proved);
    }
  }
}

TEST_CASE("no proof is false: small graphs of all kinds, by all ways of proving") {
  Random random;
  INFO(random.replay());
  int proofs = 0, refusals = 0;
  const int count = num_graphs(400);
  for (int k = 0; k < count; ++k) {
    const Index n = 2 + random.below(11);
    // Noise from none to uniform, weights over up to six orders, parallel edges.
    const double noise = random.below(8) == 0 ? 0.0
                         : random.coin()      ? random.power_of_ten(-12, -1)
                                              : pi;
    auto measurements =
        test::simulate(random, test::random_connected(random, n, random.below(3 * n)), noise);
    test::spread_weights(random, random.coin() ? 0.0 : random.uniform(0.0, 3.0), measurements);
    const MeasurementGraph graph(measurements);

    std::vector<Rotations> points = {solve(graph).rotations};
    for (int start = 0; start < 4; ++start) {
      IterationOptions options;
      options.tolerance = random.power_of_ten(-13, -2);
      options.max_iterations = 2000;
      points.push_back(bcd(graph, random.rotations(n), options).rotations);
    }
    double best = quaternion_objective(graph, points.front());
    for (const Rotations& R : points) best = std::min(best, quaternion_objective(graph, R));
    points.push_back(test::perturbed(random, points.front(), random.power_of_ten(-12, 0)));
    for (const Rotations& R : points) {
      const double f = quaternion_objective(graph, R);
      for (const CertificateOptions& options : {CertificateOptions{}, by_random_start()}) {
        const Certificate certificate = certify(graph, R, options);
        CAPTURE(k);
        CAPTURE(f);
        CAPTURE(best);
        CAPTURE(certificate.gap);
        REQUIRE(f - certificate.gap <= best + objective_rounding(graph, best));
        if (certificate.verdict != Verdict::proved) {
          ++refusals;
          continue;
        }
        ++proofs;
        if (certificate.method != CertificateMethod::factorization) continue;
        const double scale = 2.0 * graph.total_weight();
        const double lambda_min =
            test::dense_eigenvalues(test::dense_certificate_matrix(graph, R))(0);
        REQUIRE(lambda_min >= -certificate.gap - 1e-13 * scale);
      }
    }
  }
  MESSAGE(proofs << " proofs and " << refusals << " refusals on " << count << " graphs");
  CHECK(proofs > count);
  CHECK(refusals > count);
}

// The proof by a factor that is kept, and by one that is not.

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/certify/factorization.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/certificate_at.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

struct Proofs {
  CholeskyOutcome outcome;
  ComponentBound bound;
};

Proofs proofs(const MeasurementGraph& graph, const Rotations& R, double resolution, bool keeps,
              const std::function<bool()>& keep_going = {}) {
  const test::CertificateAt at(graph, R);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, at.components);
  DefiniteFactorization proof(at.S, eliminations[0], resolution,
                              objective(graph, R) / graph.total_weight(), {}, keeps ? 1e9 : 0.0);
  Proofs result;
  result.outcome = proof.factorize({});
  if (result.outcome == CholeskyOutcome::positive_definite) result.bound = proof.bound(keep_going);
  return result;
}

Solution optimum(const MeasurementGraph& graph) {
  SolveOptions options;
  options.certify = false;
  return solve(graph, options);
}

}  // namespace

TEST_CASE("a factor that is not kept proves what one does that is kept, and bounds the same gap") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.0, 1e-6, 0.01, 0.2}) {
    for (const auto& pairs : {test::grid(12, 12), test::cycle(60),
                              test::random_connected(random, 80, 120), test::complete(20)}) {
      auto edges = test::simulate(random, pairs, noise);
      if (random.coin()) test::spread_weights(random, 2.0, edges);
      const MeasurementGraph graph(edges);
      const Solution best = optimum(graph);
      // At the optimum, and so far from it that conjugate gradients have something to do.
      for (const double off : {0.0, 1e-9, 1e-6, 1e-4}) {
        const Rotations R = test::perturbed(random, best.rotations, off);
        const double resolution = 1e-8 * (objective(graph, R) + 1e-12 * graph.total_weight());
        CAPTURE(noise);
        CAPTURE(off);
        const Proofs kept = proofs(graph, R, resolution, true);
        const Proofs gone = proofs(graph, R, resolution, false);
        REQUIRE(kept.outcome == gone.outcome);
        if (kept.outcome != CholeskyOutcome::positive_definite) continue;
        CHECK(gone.bound.is_definite);
        CHECK(gone.bound.gap >= kept.bound.gap * (1.0 - 1e-6));
        CHECK(gone.bound.gap <= 1.2 * kept.bound.gap + resolution);
        if (gone.bound.gap <= resolution) {
          CHECK(gone.bound.lambda_min == -gone.bound.gap / graph.num_nodes());
        } else {
          CHECK(std::isnan(gone.bound.lambda_min));
        }
        // It holds: what is left to gain is no more.
        const double gain = objective(graph, R) - best.objective;
        CHECK(gain <= gone.bound.gap + 1e-14 * graph.total_weight());
      }
    }
  }
}

TEST_CASE("where conjugate gradients are stopped, the gap that is known is still one") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(12, 12), 0.1);
  const Solution best = optimum(graph);
  const Rotations R = test::perturbed(random, best.rotations, 1e-4);
  const double resolution = 1e-8 * best.objective;
  const ComponentBound whole = proofs(graph, R, resolution, false).bound;
  const ComponentBound stopped = proofs(graph, R, resolution, false, [] { return false; }).bound;
  CHECK(stopped.gap > 10.0 * whole.gap);
  CHECK(std::isnan(stopped.lambda_min));
  CHECK(stopped.is_definite);
}

TEST_CASE("a factor that was not kept can be made later") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(12, 12), 0.1);
  const test::CertificateAt at(graph, optimum(graph).rotations);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, at.components);
  DefiniteFactorization proof(at.S, eliminations[0], 1e-8, 0.01, {}, 0.0);
  REQUIRE(proof.factorize({}) == CholeskyOutcome::positive_definite);
  CHECK(proof.cholesky().factorize(at.S.blocks(eliminations[0])) ==
        CholeskyOutcome::positive_definite);
}

TEST_CASE("what is no minimum is refused without a factor, too") {
  Random random;
  INFO(random.replay());
  const Index n = 20;
  const MeasurementGraph graph = test::noiseless_cycle(n);
  for (const bool keeps : {true, false}) {
    CHECK(proofs(graph, test::twisted(n, 8), 1e-9, keeps).outcome ==
          CholeskyOutcome::not_positive_definite);
  }
}

TEST_CASE("a large factor is not kept: the certificate is the same, for any number of threads") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(210, 210), 0.1);
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  REQUIRE(eliminations[0].factor_bytes(3) > DefiniteFactorization::large_factor);
  CHECK(eliminations[0].definiteness_bytes(3) < 0.7 * eliminations[0].factor_bytes(3));
  SolveOptions options;
  std::vector<double> gaps;
  for (const int threads : {1, 2, 3}) {
    options.iteration.num_threads = threads;
    const Solution solution = solve(graph, options);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(solution.certificate.components[0].method == CertificateMethod::factorization);
    CHECK(std::abs(solution.certificate.lambda_min) < 1e-6);
    gaps.push_back(solution.certificate.gap);
  }
  CHECK(gaps[1] == gaps[0]);
  CHECK(gaps[2] == gaps[0]);
}

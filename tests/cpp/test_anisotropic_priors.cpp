// Full covariances where rotations, gravity or rigs are known.

#include <cstddef>
#include <optional>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/with_priors.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_precisions.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/solve_with_priors.hpp>

#include "support/anisotropic.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::anisotropic_graph;
using rotavg::test::objective_by_definition;
using rotavg::test::Random;
using rotavg::test::residuals_at;

TEST_CASE("fixed and absolute rotations, and rigs, turn precisions with them") {
  Random random;
  INFO(random.replay());
  const test::Pairs pairs = test::complete(7);
  const AnisotropicGraph graph = anisotropic_graph(random, pairs, 0.05);
  const Solution free = solve(graph);
  // What agrees with the optimum moves nothing: here a fixed node, an absolute prior and a rig.
  const Matrix3 turn = random.rotation();
  Priors priors;
  priors.fixed.push_back({0, turn * free.rotations[0]});
  priors.absolute.push_back({1, turn * free.rotations[1], 40.0});
  priors.rigs.push_back({2, 0, free.rotations[2].transpose() * free.rotations[2]});
  priors.rigs.push_back({3, 0, free.rotations[2].transpose() * free.rotations[3]});
  const GroundedGraph problem(graph.scalar(), priors);
  const Solution start = solve(problem, SolveOptions{}, std::nullopt, false);
  const Solution solution = solve(problem, {graph.precisions()}, SolveOptions{}, start.rotations);
  CHECK(solution.certificate.verdict == Verdict::proved);
  for (std::size_t i = 0; i < free.rotations.size(); ++i) {
    CHECK((solution.rotations[i] - turn * free.rotations[i]).norm() < 1e-6);
  }
}

TEST_CASE("gravity is of precision w (I - g g^T), and a free heading keeps nothing from a proof") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 12; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 8, 8), 0.05);
    const Solution free = solve(graph);
    Priors priors;
    priors.down = random.direction();
    const double w = graph.degree(0) * random.power_of_ten(-1.0, 1.0);
    const Matrix3 world = random.rotation();
    for (const Index node : {1, 3, 6}) {
      const Matrix3 tilt = exp_so3(0.05 * random.direction());
      const Vector3 down = tilt * free.rotations[node].transpose() * world * priors.down;
      priors.gravity.push_back({node, down, w * (1.0 + node)});
    }
    if (k % 3 == 0) {
      const Matrix3 near = exp_so3(0.1 * random.direction());
      priors.absolute.push_back({5, near * world.transpose() * free.rotations[5], 0.2 * w});
    }
    const GroundedGraph problem(graph.scalar(), priors);
    const GroundedPrecisions precisions{graph.precisions(), 3.0};
    const AnisotropicGraph grounded = anisotropic_graph(problem, precisions);
    CHECK(grounded.free_axes().size() == (k % 3 == 0 ? 0 : 1));
    Rotations R = random.rotations(grounded.num_nodes());
    R[0].setIdentity();
    const Rotations nodes = problem.nodes_from(R);
    double expected = objective_by_definition(graph, nodes);
    for (const auto& p : problem.priors().gravity) {
      expected += 3.0 * p.weight * (nodes[p.node] * p.down - problem.priors().down).squaredNorm();
    }
    for (const auto& p : problem.priors().absolute) {
      expected += 1.5 * p.weight * (nodes[p.node] - p.world_from_node).squaredNorm();
    }
    CHECK(residuals_at(grounded, R).objective() == doctest::Approx(expected).epsilon(1e-12));
    const Solution start = solve(problem, SolveOptions{}, std::nullopt, false);
    const Solution solution = solve(problem, precisions, SolveOptions{}, start.rotations);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(certify(problem, precisions, solution.rotations).verdict == Verdict::proved);
    // Elsewhere the bound holds, and is not what is called proved.
    for (const double angle : {1e-3, 0.1, 2.0}) {
      Rotations other = solution.rotations;
      for (Matrix3& R_i : other) R_i = exp_so3(angle * random.direction()) * R_i;
      const Certificate there = certify(problem, precisions, other);
      CHECK(there.verdict != Verdict::proved);
      const double f = residuals_at(grounded, problem.variables_from(other)).objective();
      CHECK(f - there.gap <= solution.objective * (1.0 + 1e-9));
    }
  }
}

// The staircase with full covariances, on the minorant of the objective.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/minorant.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/split.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/staircase.hpp>

#include "support/anisotropic.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::anisotropic_graph;
using rotavg::test::Random;
using rotavg::test::residuals_at;
using rotavg::test::with_eigenvalues;

TEST_CASE("no rotations cost less than the minorant says, whose gradient and Hessian are its own") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 6, 8), 0.3);
    const Rotations R = random.rotations(graph.num_nodes());
    const Minorant minorant(graph, to_quaternions(R), 1);
    const Components components = connected_components(graph.scalar());
    const LiftedProblemOf<Minorant> problem(minorant, components, 0);
    // By its definition, and below f, at other rotations Y_i = Z_i^T R_i.
    const Rotations other = random.rotations(graph.num_nodes());
    LiftedBlocks Z(3 * graph.num_nodes(), 3);
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      Z.middleRows<3>(3 * i) = R[i] * other[i].transpose();
    }
    double expected = 0.0;
    for (std::size_t e = 0; e < graph.precisions().size(); ++e) {
      const Edge& edge = graph.scalar().edges()[e];
      const Matrix3 W =
          half_trace_less(graph.precisions()[e] - closed_form_split(graph.precisions()[e]));
      CHECK(symmetric_eigen(W).values(0) > -1e-13 * graph.precisions()[e].trace());
      const Matrix3 D = other[edge.i] * edge.i_from_j() - other[edge.j];
      expected += (D * W * D.transpose()).trace();
    }
    const double f = residuals_at(graph, other).objective();
    CHECK(problem.objective(Z) == doctest::Approx(expected).epsilon(1e-9));
    CHECK(expected <= f * (1.0 + 1e-12));
    // Derivatives in five dimensions.
    LiftedBlocks wide = LiftedBlocks::Zero(Z.rows(), 5), V(wide);
    wide.leftCols(3) = Z;
    for (Eigen::Index e = 0; e < V.size(); ++e) V(e) = random.normal();
    problem.project(wide, V);
    const LiftedPoint at = problem.evaluate(wide);
    const double h = 1e-5, scale = graph.scalar().total_weight();
    const double up = problem.objective(problem.retract(wide, h * V)),
                 down = problem.objective(problem.retract(wide, -h * V));
    CHECK(std::abs((up - down) / (2.0 * h) - at.gradient.cwiseProduct(V).sum()) < 1e-5 * scale);
    const LiftedBlocks change = (problem.evaluate(problem.retract(wide, h * V)).gradient -
                                 problem.evaluate(problem.retract(wide, -h * V)).gradient) /
                                (2.0 * h);
    LiftedBlocks tangent = change;
    problem.project(wide, tangent);
    CHECK((tangent - problem.hessian(at, V)).norm() < 1e-4 * scale);
  }
}

TEST_CASE("from a ring that is wound once the staircase comes down unwound") {
  Random random;
  INFO(random.replay());
  const Index n = 16;
  std::vector<RelativeRotation> measurements;
  std::vector<Matrix3> precisions;
  for (Index ring = 0; ring < 2; ++ring) {  // two components
    for (const auto& [i, j] : test::cycle(n)) {
      measurements.push_back({100 * ring + i, 100 * ring + j, exp_so3(0.01 * random.direction())});
      precisions.push_back(with_eigenvalues(random, {1.0, ring == 0 ? 3.0 : 1.0, 30.0}));
    }
  }
  const AnisotropicGraph graph(MeasurementGraph(measurements), precisions);
  Rotations start = test::twisted(n, 1);
  const Rotations other = test::twisted(n, -1);
  start.insert(start.end(), other.begin(), other.end());
  SolveOptions options;
  options.max_rank = 0;
  options.method = Method::newton;
  const Solution stuck = solve(graph, options, start);
  REQUIRE(stuck.objective > 1.0);
  CHECK(stuck.certificate.verdict == Verdict::not_certified);
  for (const Method method : {Method::automatic, Method::staircase}) {
    options.max_rank = 10;
    options.method = method;
    const Solution solution = solve(graph, options, stuck.rotations);
    CHECK(solution.objective < 0.1 * stuck.objective);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(solution.rotations[n] == Matrix3::Identity());
  }
}

TEST_CASE("the staircase's bound lies below all rotations") {
  Random random;
  INFO(random.replay());
  int bounded = 0;
  for (int k = 0; k < 20; ++k) {
    CAPTURE(k);
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 8, 8), 1.5);
    SolveOptions options;
    double lowest = std::numeric_limits<double>::infinity(), lower = 0.0;
    for (int start = 0; start < 6; ++start) {
      const Solution solution = solve(graph, options, random.rotations(graph.num_nodes()));
      lowest = std::min(lowest, solution.objective);
      lower = std::max(lower, solution.objective - solution.certificate.gap);
      bounded += solution.certificate.method == CertificateMethod::relaxation;
    }
    CHECK(lower <= lowest * (1.0 + 1e-9));
  }
  CHECK(bounded > 0);
}

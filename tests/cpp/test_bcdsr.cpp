#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/LU>

#include <rotavg/init/random.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/bcdsr.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// How far Y is from what (6) asks of it.
double infeasibility(const Eigen::MatrixXd& Y) {
  double worst = (Y - Y.transpose()).cwiseAbs().maxCoeff();
  for (Eigen::Index at = 0; at < Y.rows(); at += 3) {
    const Matrix3 error = Y.block<3, 3>(at, at) - Matrix3::Identity();
    worst = std::max(worst, error.cwiseAbs().maxCoeff());
  }
  return std::max(worst, -test::dense_eigenvalues(Y)(0));
}

MeasurementGraph two_triangles_and_a_node(Random& random) {
  const auto measurements =
      test::simulate(random, {{0, 2}, {2, 5}, {5, 0}, {1, 3}, {3, 6}, {6, 1}}, 0.3);
  return MeasurementGraph(measurements, {0, 1, 2, 3, 4, 5, 6});
}

}  // namespace

TEST_CASE("Y stays feasible and its objective is 6 sum w - tr(Rt Y)") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.0, 0.3, 2.0}) {
    for (const double decades : {0.0, 2.0}) {
      auto measurements = test::simulate(random, test::random_connected(random, 12, 20), noise);
      test::spread_weights(random, decades, measurements);
      const MeasurementGraph graph(measurements);
      SemidefiniteRelaxation relaxation(graph, random.rotations(12), 1);
      CAPTURE(noise);
      CAPTURE(decades);
      for (int sweep = 0; sweep < 20; ++sweep) {
        for (Index k = 0; k < 12; ++k) relaxation.minimize_block(k);
        const Eigen::MatrixXd& Y = relaxation.matrix();
        REQUIRE(infeasibility(Y) < 1e-7);
        const double expected =
            6.0 * graph.total_weight() - test::dense_measurements(graph).cwiseProduct(Y).sum();
        REQUIRE(relaxation.objective() == doctest::Approx(expected).epsilon(0).scale(1).epsilon(
                                              1e-12 * graph.total_weight()));
      }
    }
  }
}

TEST_CASE("no other block column that keeps Y positive semidefinite is better") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(6), 0.7);
  SemidefiniteRelaxation relaxation(graph, random.rotations(6), 1);
  for (int sweep = 0; sweep < 2; ++sweep) {
    for (Index k = 0; k < 6; ++k) relaxation.minimize_block(k);
  }
  const Eigen::MatrixXd Rt = test::dense_measurements(graph);
  const auto cost = [&](const Eigen::MatrixXd& Y) { return -Rt.cwiseProduct(Y).sum(); };
  for (Index k = 0; k < 6; ++k) {
    relaxation.minimize_block(k);
    const Eigen::MatrixXd best = relaxation.matrix();
    const Eigen::Index at = 3 * k;
    // With B = V V^T, the feasible columns are V Q, |Q| <= 1: all those of three rows of a larger
    // Gram matrix. Mixtures of the best column with a few of those are feasible as well.
    for (int trial = 0; trial < 200; ++trial) {
      const Eigen::MatrixXd other_row = best.middleRows<3>(3 * random.below(6));
      const Matrix3 turn = random.rotation();
      Eigen::MatrixXd column = (turn * other_row).transpose();  // <= 1 as Y_ii = I
      const double t = std::pow(10.0, -random.below(5));
      column = (1.0 - t) * best.middleCols<3>(at) + t * column;
      Eigen::MatrixXd Y = best;
      Y.middleCols<3>(at) = column;
      Y.middleRows<3>(at) = column.transpose();
      Y.block<3, 3>(at, at).setIdentity();
      REQUIRE(test::dense_eigenvalues(Y)(0) > -1e-7);
      REQUIRE(cost(Y) >= cost(best) - 1e-7);
    }
  }
}

TEST_CASE("the objective of (6) never rises and ends at f*, as do the rotations") {
  Random random;
  INFO(random.replay());
  for (const test::Pairs& pairs :
       {test::path(2), test::path(7), test::complete(3), test::complete(20), test::cycle(5),
        test::random_connected(random, 20, 30)}) {
    auto measurements = test::simulate(random, pairs, 0.3);
    test::spread_weights(random, 0.5, measurements);
    const MeasurementGraph graph(measurements);
    const double optimum = newton(graph, shortest_path_init(graph)).objective;
    for (const Rotations& start :
         {shortest_path_init(graph), random.rotations(graph.num_nodes())}) {
      IterationOptions options;
      options.tolerance = 1e-10;
      const IterationResult result = bcdsr(graph, start, options);
      CAPTURE(graph.num_nodes());
      CAPTURE(graph.num_edges());
      REQUIRE(is_converged(result.status));
      REQUIRE(result.trace.size() == static_cast<std::size_t>(result.iterations) + 1);
      const double rounding = 1e-13 * graph.total_weight();
      for (std::size_t k = 1; k < result.trace.size(); ++k) {
        REQUIRE(result.trace[k].objective <= result.trace[k - 1].objective + rounding);
      }
      REQUIRE(result.objective == objective(graph, result.rotations));
      REQUIRE(std::abs(result.objective - optimum) <= 1e-9 * optimum + rounding);
      // A tree's start is exact: nothing is left to do, and Y has not moved.
      if (result.iterations > 0) {
        REQUIRE(std::abs(result.trace.back().objective - optimum) <= 1e-6 * optimum + rounding);
      }
    }
  }
}

TEST_CASE("where the relaxation is not tight, its objective is a lower bound and it still ends") {
  Random random;
  INFO(random.replay());
  int loose = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const MeasurementGraph graph =
        test::simulate_graph(random, test::random_connected(random, 8, 6), 3.0);
    IterationOptions options;
    options.tolerance = 1e-7;
    const IterationResult result = bcdsr(graph, shortest_path_init(graph), options);
    CHECK(is_converged(result.status));
    const double lower = result.trace.back().objective;
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      const double found = newton(graph, random_init(graph, seed)).objective;
      REQUIRE(found >= lower - 1e-6 * graph.total_weight());
    }
    loose += result.objective > lower + 1e-3;
  }
  CHECK(loose > 0);
}

TEST_CASE("components and nodes without edges keep to themselves") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = two_triangles_and_a_node(random);
  const IterationResult result = bcdsr(graph, random.rotations(7));
  CHECK(is_converged(result.status));
  const double optimum = newton(graph, shortest_path_init(graph)).objective;
  CHECK(result.objective == doctest::Approx(optimum).epsilon(1e-9));
  for (const Index root : {0, 1, 4}) CHECK(result.rotations[root].isIdentity(1e-12));
}

TEST_CASE("contradictory and extreme measurements give finite rotations") {
  // R and -R cannot both be measured, but three turns by pi about the axes and the identity add up
  // to nothing.
  const Matrix3 x = Vector3(1, -1, -1).asDiagonal(), y = Vector3(-1, 1, -1).asDiagonal(),
                z = Vector3(-1, -1, 1).asDiagonal();
  for (const double weight : {1e-100, 1.0, 1e100}) {
    const MeasurementGraph graph({{0, 1, x, weight},
                                  {0, 1, y, weight},
                                  {0, 1, z, weight},
                                  {0, 1, Matrix3::Identity(), weight},
                                  {1, 2, x, weight}});
    const IterationResult result = bcdsr(graph, {x, y, z});
    CHECK(std::isfinite(result.objective));
    for (const Matrix3& R : result.rotations) {
      CHECK((R.transpose() * R - Matrix3::Identity()).cwiseAbs().maxCoeff() < 1e-14);
      CHECK(R.determinant() > 0.0);
    }
    // The contradiction costs the same whatever the rotations: 24 w.
    CHECK(result.objective / weight == doctest::Approx(24.0));
  }
}

TEST_CASE("the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(100), 0.3);
  const Rotations start = random.rotations(100);
  IterationOptions options;
  options.num_threads = 1;
  const IterationResult one = bcdsr(graph, start, options);
  options.num_threads = 3;
  const IterationResult three = bcdsr(graph, start, options);
  CHECK(std::memcmp(one.rotations.data(), three.rotations.data(), 100 * sizeof(Matrix3)) == 0);
  CHECK(one.trace.back().objective == three.trace.back().objective);
}

TEST_CASE("limits end the work, in the middle of a sweep too") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::cycle(30), 0.3);
  IterationOptions options;
  options.max_iterations = 0;
  CHECK(bcdsr(graph, random.rotations(30), options).status == Status::iteration_limit);
  options.max_iterations = 100;
  int questions = 0;
  options.keep_going = [&] { return ++questions < 50; };
  const IterationResult result = bcdsr(graph, random.rotations(30), options);
  CHECK(result.status == Status::stopped);
  CHECK(questions < 55);
}

TEST_CASE("a matrix larger than the memory is refused before anything is done") {
  constexpr Index n = 1000000;  // 72 TB
  const MeasurementGraph graph = test::noiseless_cycle(n);
  SolveOptions options;
  options.method = Method::bcdsr;
  CHECK_THROWS_WITH_AS(solve(graph, options), doctest::Contains("7.2e+04 GB"), TooLarge);
}

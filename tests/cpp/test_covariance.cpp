#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/selected_inverse.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/rotavg.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using Eigen::MatrixXd;
using namespace rotavg;
using rotavg::test::Random;

namespace {

struct Solved {
  MeasurementGraph graph;
  Rotations rotations;
};

Solved solved(Random& random, const test::Pairs& pairs, double noise) {
  auto measurements = test::simulate(random, pairs, noise);
  test::spread_weights(random, 0.5, measurements);
  MeasurementGraph graph(measurements);
  SolveOptions options;
  options.iteration.tolerance = 1e-12;
  Rotations R = solve(graph, options).rotations;
  return {std::move(graph), std::move(R)};
}

/// The Hessian of f by central differences of the objective, 3n x 3n.
MatrixXd hessian_by_differences(const MeasurementGraph& graph, const Rotations& R) {
  constexpr double h = 1e-3;
  const Eigen::Index size = 3 * static_cast<Eigen::Index>(R.size());
  const auto f = [&](Eigen::VectorXd w) {
    Rotations moved = R;
    for (std::size_t i = 0; i < R.size(); ++i) {
      moved[i] = exp_so3(w.segment<3>(3 * static_cast<Eigen::Index>(i))) * moved[i];
    }
    return objective(graph, moved);
  };
  MatrixXd H(size, size);
  for (Eigen::Index a = 0; a < size; ++a) {
    for (Eigen::Index b = 0; b <= a; ++b) {
      const auto at = [&](double x, double y) {
        Eigen::VectorXd w = Eigen::VectorXd::Zero(size);
        w(a) += x;
        w(b) += y;
        return f(w);
      };
      H(a, b) = H(b, a) = (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4.0 * h * h);
    }
  }
  return H;
}

std::vector<NodePair> all_pairs(Index n) {
  std::vector<NodePair> pairs;
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) pairs.push_back({i, j});
  }
  return pairs;
}

}  // namespace

TEST_CASE("covariances of all pairs are those of the dense inverse of the Hessian") {
  Random random;
  INFO(random.replay());
  for (const auto& pairs : {test::grid(3, 4), test::cycle(7), test::complete(6),
                            test::random_connected(random, 14, 9)}) {
    const Solved s = solved(random, pairs, 0.2);
    const Index n = s.graph.num_nodes();
    const MatrixXd H = hessian_by_differences(s.graph, s.rotations);
    const Eigen::Index rest = H.rows() - 3;
    MatrixXd S = MatrixXd::Zero(H.rows(), H.rows());
    S.bottomRightCorner(rest, rest) =
        H.bottomRightCorner(rest, rest).llt().solve(MatrixXd::Identity(rest, rest));
    CovarianceOptions options;
    options.noise_variance = 0.3;
    const auto wanted = all_pairs(n);
    const Covariances found = covariances(s.graph, s.rotations, wanted, options);
    REQUIRE(found.status == CovarianceStatus::computed);
    for (std::size_t k = 0; k < wanted.size(); ++k) {
      const auto i = 3 * wanted[k].base, j = 3 * wanted[k].node;
      const Matrix3 dense =
          S.block<3, 3>(i, i) + S.block<3, 3>(j, j) - S.block<3, 3>(i, j) - S.block<3, 3>(j, i);
      CAPTURE(k);
      CHECK((found.pairs[k] - 4.0 * 0.3 * dense).norm() <= 1e-5 * S.norm());
    }
  }
}

TEST_CASE("without noise a path adds up the variances of its edges, and a cycle halves them") {
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : test::path(5)) measurements.push_back({i, j, exp_so3({0.1, 0.2, 0.3})});
  double variance = 0.0;
  for (RelativeRotation& m : measurements) m.weight = 1.0 / (variance += 1.0);
  const MeasurementGraph path(measurements);
  const auto on_path = covariances(path, shortest_path_init(path), {{0, 4}, {3, 1}, {2, 2}});
  CHECK((on_path.pairs[0] - 10.0 * Matrix3::Identity()).norm() <= 1e-12);
  CHECK((on_path.pairs[1] - 5.0 * Matrix3::Identity()).norm() <= 1e-12);
  CHECK(on_path.pairs[2].norm() == 0.0);

  const MeasurementGraph cycle = test::noiseless_cycle(8);
  const auto on_cycle = covariances(cycle, Rotations(8, Matrix3::Identity()), {{2, 6}});
  CHECK((on_cycle.pairs[0] - 2.0 * Matrix3::Identity()).norm() <= 1e-12);
}

TEST_CASE("selected inversion of larger factors agrees with solves") {
  Random random;
  INFO(random.replay());
  const Solved s = solved(random, test::random_connected(random, 300, 400), 0.05);
  const Components components = connected_components(s.graph);
  const ResidualQuaternions residuals(s.graph, to_quaternions(s.rotations), 1);
  Elimination elimination(s.graph, components, 0);
  BlockCholesky<3> cholesky(elimination.symbolic());
  REQUIRE(cholesky.factorize(hessian_blocks(residuals, elimination)) ==
          CholeskyOutcome::positive_definite);
  const SelectedInverse<3> inverse(cholesky);
  for (int repeat = 0; repeat < 20; ++repeat) {
    const Index a = random.below(elimination.size());
    MatrixXd columns = MatrixXd::Zero(cholesky.size(), 3);
    columns.middleRows<3>(3 * a).setIdentity();
    cholesky.solve_in_place(columns);
    int entries = 0;
    for (Index b = 0; b < elimination.size(); ++b) {
      if (!inverse.has(b, a)) continue;
      ++entries;
      CHECK((inverse(b, a) - columns.middleRows<3>(3 * b)).norm() <= 1e-10 * columns.norm());
    }
    CHECK(entries >= 2);
  }
}

#ifdef __linux__
TEST_CASE("no threads are started beyond those asked for") {
  const auto num_threads = [] {
    const std::filesystem::directory_iterator tasks("/proc/self/task");
    return std::distance(begin(tasks), end(tasks));
  };
  Random random;
  INFO(random.replay());
  const auto [graph, R] = solved(random, test::grid(40, 40), 0.05);
  std::vector<NodePair> pairs;
  for (Index i = 1; i < graph.num_nodes(); ++i) pairs.push_back({0, i});
  const auto before = num_threads();
  CHECK(covariances(graph, R, pairs).status == CovarianceStatus::computed);
  CHECK(num_threads() == before);  // helpers stay once they are there
}
#endif

TEST_CASE("a saddle has no covariance, and pairs of two components none either") {
  const MeasurementGraph cycle = test::noiseless_cycle(5);
  CHECK(covariances(cycle, test::twisted(5, 2), {{0, 1}}).status ==
        CovarianceStatus::not_a_minimum);
  const MeasurementGraph two({{0, 1}, {2, 3}});
  const Rotations R(4, Matrix3::Identity());
  CHECK_THROWS_AS(covariances(two, R, {{0, 2}}), std::invalid_argument);
  const auto both = covariances(two, R, {{0, 1}, {2, 3}, {3, 3}});
  REQUIRE(both.status == CovarianceStatus::computed);
  CHECK((both.pairs[1] - Matrix3::Identity()).norm() <= 1e-12);
  CovarianceOptions stop;
  stop.keep_going = [] { return false; };
  CHECK(covariances(cycle, Rotations(5, Matrix3::Identity()), {{0, 1}}, stop).status ==
        CovarianceStatus::stopped);
}

TEST_CASE(
    "with information matrices a saddle has none either, and edges that know nothing may join") {
  const MeasurementGraph cycle = test::noiseless_cycle(5);
  CovarianceOptions options;
  options.information.assign(5, Matrix3::Identity());
  CHECK(covariances(cycle, test::twisted(5, 2), {{0, 1}}, options).status ==
        CovarianceStatus::not_a_minimum);
  const Rotations R(5, Matrix3::Identity());
  options.information[4] = Matrix3::Zero();
  const auto path = covariances(cycle, R, {{0, 4}}, options);
  REQUIRE(path.status == CovarianceStatus::computed);
  CHECK((path.pairs[0] - 4.0 * Matrix3::Identity()).norm() <= 1e-9);
  options.information.assign(5, Matrix3::Zero());
  CHECK(covariances(cycle, R, {{0, 1}}, options).status == CovarianceStatus::not_a_minimum);
}

TEST_CASE("what cannot have covariances is refused") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      test::simulate_graph(random, test::random_connected(random, 8, 12), 0.05);
  const Rotations R = solve(graph).rotations;
  const GroundedGraph problem(graph, [&] {
    Priors priors;
    priors.absolute.push_back({3, R[3], 1.0});
    return priors;
  }());
  for (const NodePair& pair : {NodePair{0, 1000000}, NodePair{-1, 3}, NodePair{0, 8}}) {
    CHECK_THROWS_AS(covariances(graph, R, {pair}), std::invalid_argument);
    CHECK_THROWS_AS(covariances(problem, R, {pair}), std::invalid_argument);
  }
  for (const Rotations& few : {Rotations(), Rotations(2, Matrix3::Identity())}) {
    CHECK_THROWS_AS(covariances(graph, few, {{0, 1}}), std::invalid_argument);
    CHECK_THROWS_AS(covariances(problem, few, {{0, 1}}), std::invalid_argument);
    CHECK_THROWS_AS(marginal_covariances(problem, few), std::invalid_argument);
    CHECK_THROWS_AS(objective(problem, few), std::invalid_argument);
  }
  Rotations scaled = R;
  scaled[0] *= 3.0;
  CHECK_THROWS_AS(covariances(graph, scaled, {{0, 1}}), InvalidRotation);
  CHECK_THROWS_AS(marginal_covariances(problem, scaled), InvalidRotation);
  for (const double variance : {std::nan(""), -1.0, std::numeric_limits<double>::infinity()}) {
    CovarianceOptions options;
    options.noise_variance = variance;
    CHECK_THROWS_AS(covariances(graph, R, {{0, 1}}, options), std::invalid_argument);
    CHECK_THROWS_AS(marginal_covariances(problem, R, options), std::invalid_argument);
  }
  CovarianceOptions options;
  options.information.assign(graph.edges().size() - 1, Matrix3::Identity());
  CHECK_THROWS_AS(covariances(graph, R, {{0, 1}}, options), std::invalid_argument);
  CHECK_THROWS_AS(covariances(problem, R, {{0, 1}}, options), std::invalid_argument);
  options.information.push_back(-Matrix3::Identity());
  CHECK_THROWS_AS(covariances(graph, R, {{0, 1}}, options), InvalidEdge);
  CHECK_THROWS_AS(covariances(problem, R, {{0, 1}}, options), InvalidEdge);
  options.information.clear();
  options.turn_of.assign(8, 0);
  CHECK_THROWS_AS(covariances(graph, R, {{0, 1}}, options), std::invalid_argument);
}

TEST_CASE("marginal covariances with priors are those of heavy absolute priors in the limit") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      test::simulate_graph(random, test::random_connected(random, 10, 20), 0.05);
  const Rotations R = solve(graph).rotations;
  Priors held, heavy;
  for (const NodeId node : {2, 5}) {
    held.fixed.push_back({node, R[node]});
    heavy.absolute.push_back({node, R[node], 1e7});
  }
  for (Priors* priors : {&held, &heavy}) {
    priors->gravity.push_back({8, R[8].transpose() * priors->down, 3.0});
  }
  const GroundedGraph a(graph, held), b(graph, heavy);
  const auto A = marginal_covariances(a, solve(a).rotations);
  const auto B = marginal_covariances(b, solve(b).rotations);
  REQUIRE(A.status == CovarianceStatus::computed);
  REQUIRE(B.status == CovarianceStatus::computed);
  for (Index i = 0; i < 10; ++i) CHECK((A.pairs[i] - B.pairs[i]).norm() < 1e-5);
  CHECK(A.pairs[2].norm() == 0.0);
  const auto pair = covariances(a, solve(a).rotations, {{2, 7}});
  CHECK((pair.pairs[0] - A.pairs[7]).norm() < 1e-12);
}

TEST_CASE("covariances with priors take no free turns but gravity's, and no other rows") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      test::simulate_graph(random, test::random_connected(random, 6, 8), 0.05);
  Priors priors;
  priors.gravity = {{1, Vector3::UnitX(), 2.0}};
  const GroundedGraph problem(graph, priors);
  const Rotations R = solve(problem).rotations;
  CovarianceOptions options;
  const auto expected = covariances(problem, R, {{0, 3}}, options);
  options.free_turns = {{2, Vector3::UnitZ()}};
  options.turn_of.assign(7, 0);
  const auto found = covariances(problem, R, {{0, 3}}, options);
  REQUIRE(found.status == CovarianceStatus::computed);
  CHECK(found.pairs[0] == expected.pairs[0]);
  CHECK_THROWS_AS(covariances(problem, R, {{0, 6}}), std::invalid_argument);
  CHECK_THROWS_AS(covariances(problem, R, {{-1, 2}}), std::invalid_argument);
  // Precisions of edges and priors that are those of weights: nearly the same covariances.
  for (const Edge& e : graph.edges()) options.information.push_back(multiple_of_identity(e.weight));
  const auto precise = covariances(problem, R, {{0, 3}}, options);
  REQUIRE(precise.status == CovarianceStatus::computed);
  CHECK((precise.pairs[0] - found.pairs[0]).norm() < 0.1 * found.pairs[0].norm());
}

#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Core>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/complement_bound.hpp>
#include <rotavg/certify/known_cut.hpp>
#include <rotavg/certify/local_operator.hpp>
#include <rotavg/certify/random_start_bound.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/certificate_at.hpp"
#include "support/certificates.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::CertificateAt;
using rotavg::test::Random;

namespace {

MeasurementGraph random_graph(Random& random, Index n, double noise) {
  auto measurements =
      test::simulate(random, test::random_connected(random, n, random.below(3 * n)), noise);
  test::spread_weights(random, random.coin() ? 0.0 : 1.0, measurements);
  return MeasurementGraph(measurements);
}

/// The scalar Laplacian on blocks, in the frames of the nodes.
Eigen::MatrixXd dense_laplacian(const MeasurementGraph& graph, const Rotations& R) {
  const Eigen::Index size = 3 * graph.num_nodes();
  Eigen::MatrixXd L = Eigen::MatrixXd::Zero(size, size);
  for (const Edge& e : graph.edges()) {
    const Matrix3 across = e.weight * R[e.i].transpose() * R[e.j];
    L.block<3, 3>(3 * e.i, 3 * e.j) -= across;
    L.block<3, 3>(3 * e.j, 3 * e.i) -= across.transpose();
    for (const Index end : {e.i, e.j}) {
      L.block<3, 3>(3 * end, 3 * end) += e.weight * Matrix3::Identity();
    }
  }
  return L;
}

/// tr(K^T S^+ K), S on the complement of D^1/2 N.
double dense_gap(const MeasurementGraph& graph, const Rotations& R, const Eigen::MatrixXd& K) {
  const Eigen::MatrixXd M =
      test::scaled_on_complement(graph, R, test::dense_certificate_matrix(graph, R));
  Eigen::MatrixXd scaled(K.rows(), 3);
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    scaled.middleRows<3>(3 * i) =
        R[i].transpose() * K.middleRows<3>(3 * i) / std::sqrt(graph.degree(i));
  }
  const Eigen::MatrixXd N = test::scaled_null_vectors(graph, R);
  scaled -= N * (N.transpose() * scaled);
  return scaled.cwiseProduct(M.ldlt().solve(scaled)).sum();
}

}  // namespace

TEST_CASE("off the optimum, the gap is what S makes of the leftover, and what other points gain") {
  Random random;
  INFO(random.replay());
  int positive = 0, smaller = 0;
  for (int k = 0; k < 200; ++k) {
    const Index n = 2 + random.below(15);
    const MeasurementGraph graph = random_graph(random, n, random.uniform(0.0, 0.2));
    const Rotations optimum = solve(graph).rotations;
    const Rotations R =
        test::perturbed(random, optimum, std::pow(10.0, random.uniform(-7.0, -1.0)));
    const CertificateAt at(graph, R);
    const double least = test::scaled_eigenvalues(graph, R)(0);
    if (!(least > 1e-3)) continue;
    ++positive;
    const LocalOperator<3> M(at.S, at.q);
    const Eigen::MatrixXd K = at.S.leftover();
    const double cut = 0.1 * least, expected = dense_gap(graph, R, K);
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const ComponentBound plain = ComplementBound(M, K, cut, {})(0.0, infinity);
    const ComponentBound bound = ComplementBound(M, K, cut, {})(0.0, 0.0);
    CAPTURE(k);
    CAPTURE(expected);
    CHECK(bound.gap <= plain.gap);
    smaller += bound.gap < 0.5 * plain.gap ? 1 : 0;
    const auto never = [] { return false; };
    const ComponentBound stopped = ComplementBound(M, K, cut, never)(0.0, 0.0);
    CHECK(stopped.gap <= plain.gap);
    CHECK(stopped.gap >= expected * (1.0 - 1e-7));
    CHECK(bound.gap >= expected * (1.0 - 1e-7));
    CHECK(bound.gap <= 1.3 * expected);
    const double gain = objective(graph, R) - objective(graph, optimum);
    CHECK(bound.gap >= gain - objective_rounding(graph, objective(graph, R)));
    // What rounding can have done to K stands beside it, under the root.
    const ComponentBound rounded = ComplementBound(M, K, cut, {})(3e-3, 0.0);
    CHECK(std::sqrt(rounded.gap) == doctest::Approx(std::sqrt(bound.gap) + 3e-3));
    CHECK(rounded.rounding == doctest::Approx(9e-6));
  }
  CHECK(positive > 100);
  CHECK(smaller > 50);
}

TEST_CASE("S is at least the share of the Laplacian that the rounding of edges is held against") {
  Random random;
  INFO(random.replay());
  int positive = 0;
  for (int k = 0; k < 200; ++k) {
    const Index n = 3 + random.below(15);
    const MeasurementGraph graph =
        random_graph(random, n, std::pow(10.0, random.uniform(-6.0, 0.0)));
    const Rotations R = solve(graph).rotations;
    const CertificateAt at(graph, R);
    const double cut = test::scaled_eigenvalues(graph, R)(0);
    if (!(cut > 1e-6)) continue;
    ++positive;
    const double kappa = share_of_laplacian(at.S, cut);
    CHECK(kappa > 0.0);
    CHECK(kappa <= 1.0);
    const Eigen::MatrixXd left =
        test::dense_certificate_matrix(graph, R) - kappa * dense_laplacian(graph, R);
    CHECK(test::dense_eigenvalues(test::scaled_on_complement(graph, R, left))(0) > -1e-12);
  }
  CHECK(positive > 100);
}

TEST_CASE("what is proved at some rotations holds near them, and is forgotten far away") {
  Random random;
  INFO(random.replay());
  int kept = 0, forgotten = 0;
  for (int k = 0; k < 200; ++k) {
    const Index n = 3 + random.below(15);
    const MeasurementGraph graph = random_graph(random, n, 0.1);
    const Rotations optimum = solve(graph).rotations;
    const double least = test::scaled_eigenvalues(graph, optimum)(0);
    if (!(least > 1e-3)) continue;
    KnownCut known;
    const CertificateAt at(graph, optimum);
    CHECK(known.at(at.S, at.q) == 0.0);
    known.remember(at.S, at.q, least);
    CHECK(known.at(at.S, at.q) == doctest::Approx(least));
    const Matrix3 turn = random.rotation();
    const double size = std::pow(10.0, random.uniform(-5.0, 0.0));
    Rotations R = optimum;
    if (random.coin()) {
      R = test::perturbed(random, optimum, size);
    } else {  // one alone: node 0, from which the common turn is read, among them
      const Index one = random.below(n);
      R[one] = exp_so3(size * random.normal_vector()) * R[one];
    }
    for (Matrix3& R_i : R) R_i = (turn * R_i).eval();
    const CertificateAt there(graph, R);
    const double cut = known.at(there.S, there.q);
    (cut > 0.0 ? kept : forgotten) += 1;
    if (cut > 0.0) CHECK(test::scaled_eigenvalues(graph, R)(0) >= cut - 1e-12);
  }
  CHECK(kept > 20);
  CHECK(forgotten > 20);
}

TEST_CASE("with what an earlier certificate has proved, the next one draws no start") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      simulate_graph(random, test::random_connected(random, 300, 1500), 0.01);
  const Rotations optimum = solve(graph).rotations;
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components, 1);
  std::vector<KnownCut> cuts;
  int asked = 0;
  CertificateOptions options = test::by_random_start();
  options.num_threads = 1;
  options.keep_going = [&asked] {
    ++asked;
    return true;
  };
  const auto certified = [&](const Rotations& R) {
    asked = 0;
    return certify(graph, R, components, eliminations, options, {}, {}, &cuts);
  };
  CHECK(certified(optimum).verdict == Verdict::proved);
  const int at_first = asked;
  const Certificate again = certified(test::perturbed(random, optimum, 1e-8));
  CHECK(again.method == CertificateMethod::random_start);
  CHECK(again.failure_probability == options.failure_probability);
  CHECK(asked < at_first / 2);
  CHECK(certified(test::perturbed(random, optimum, 0.5)).verdict == Verdict::not_certified);
}

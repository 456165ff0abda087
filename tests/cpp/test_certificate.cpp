#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/bcd.hpp>

#include "support/blocks.hpp"
#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;

/// A stationary point, to rounding: not always the global optimum.
Rotations descend(const MeasurementGraph& graph, Rotations start) {
  IterationOptions options;
  options.tolerance = 1e-13;
  options.max_iterations = 5000;
  return bcd(graph, std::move(start), options).rotations;
}

/// The smallest objective that several starts lead to: at least f*.
double best_objective(Random& random, const MeasurementGraph& graph) {
  double best = objective(graph, descend(graph, shortest_path_init(graph)));
  for (int k = 0; k < 5; ++k) {
    const Rotations R = descend(graph, random.rotations(graph.num_nodes()));
    best = std::min(best, objective(graph, R));
  }
  return best;
}

MeasurementGraph small_graph(Random& random, double noise) {
  const Index n = 2 + random.below(9);
  auto measurements = test::simulate(random, test::random_connected(random, n, 2 * n), noise);
  test::spread_weights(random, random.coin() ? 0.0 : 1.0, measurements);
  return MeasurementGraph(measurements);
}

double max_degree(const MeasurementGraph& graph) {
  double largest = 0.0;
  for (Index i = 0; i < graph.num_nodes(); ++i) largest = std::max(largest, graph.degree(i));
  return largest;
}

double dense_lambda_min(const MeasurementGraph& graph, const Rotations& R) {
  return test::dense_eigenvalues(test::dense_certificate_matrix(graph, R))(0);
}

/// S with all that it refers to.
struct CertificateAt {
  Components components;
  ResidualQuaternions residuals;
  NodeSums sums;
  CertificateMatrix S;

  CertificateAt(const MeasurementGraph& graph, const Rotations& R)
      : components(connected_components(graph)),
        residuals(graph, to_quaternions(R), 1),
        sums(residuals),
        S(sums, components, 0) {}
  CertificateAt(const CertificateAt&) = delete;
};

CertificateOptions by_random_start() {
  CertificateOptions options;
  options.max_factorization_flops = 0.0;
  return options;
}

CertificateOptions by_eigenvalue() {
  CertificateOptions options = by_random_start();
  options.failure_probability = 0.0;
  return options;
}

}  // namespace

TEST_CASE("S is Lambda - Rt, as an operator and as a sparse matrix without its first nodes") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = small_graph(random, 0.5);
    const Rotations R = random.rotations(graph.num_nodes());
    const CertificateAt at(graph, R);
    const CertificateMatrix& S = at.S;
    const Eigen::MatrixXd dense =
        test::in_global_frame(test::dense_certificate_matrix(graph, R), R);
    const double tolerance = 1e-14 * dense.norm();
    const Eigen::Index size = dense.rows();
    REQUIRE((S.apply(Eigen::MatrixXd::Identity(size, size)) - dense).norm() < tolerance);
    for (const Index skipped : {0, 1}) {
      const Eigen::Index rest = size - 3 * skipped;
      Elimination elimination(graph, at.components, 0, skipped);
      const auto blocks = S.blocks(elimination);
      const Eigen::MatrixXd sparse = test::dense_symmetric<3>(elimination.pattern(), blocks);
      REQUIRE((sparse - dense.bottomRightCorner(rest, rest)).norm() < tolerance);
    }
    // tr(Lambda) = tr(R Rt R^T) at any R.
    const double trace_lambda = dense.trace();  // Rt has no diagonal blocks
    REQUIRE(trace_lambda == doctest::Approx(6.0 * graph.total_weight() - objective(graph, R))
                                .epsilon(1e-12)
                                .scale(graph.total_weight()));
  }
}

TEST_CASE("what S leaves of R^T is sqrt(2) / 4 of the gradient, and nothing where that vanishes") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = small_graph(random, 0.3);
    const Rotations R = random.rotations(graph.num_nodes());
    const CertificateAt at(graph, R);
    const CertificateMatrix& S = at.S;
    const double root_n = std::sqrt(double(graph.num_nodes()));  // the null vectors have length one
    REQUIRE((S.apply(root_n * S.null_vectors()) - S.leftover()).norm() <
            1e-13 * graph.total_weight());
    REQUIRE(S.leftover().norm() ==
            doctest::Approx(std::sqrt(2.0) / 4.0 * gradient_norm(graph, R).absolute));

    const Rotations stationary = descend(graph, R);
    const CertificateAt there(graph, stationary);
    const CertificateMatrix& at_stationary = there.S;
    REQUIRE(at_stationary.leftover().norm() < 1e-12 * graph.total_weight());
    REQUIRE(at_stationary.apply(at_stationary.null_vectors()).norm() <
            1e-12 * graph.total_weight());
  }
}

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

TEST_CASE("a full extra twist of a noiseless cycle is stationary and refuted, lambda_min exact") {
  for (const Index n : {20, 100, 500}) {
    for (const int turns : {1, -1, 2}) {
      const MeasurementGraph graph = test::noiseless_cycle(n);
      const Rotations R = test::twisted(n, turns);
      const double edge_angle = 2.0 * pi * turns / n;
      CAPTURE(n);
      CAPTURE(turns);
      REQUIRE(gradient_norm(graph, R).relative < 1e-14);
      const double f = objective(graph, R);
      REQUIRE(f == doctest::Approx(4.0 * n * (1.0 - std::cos(edge_angle))).epsilon(1e-10));
      // In the frame of the solution S is circulant: 2 cos(a) - 2 cos(2 pi k / n +- a) across the
      // axis and 2 - 2 cos(2 pi k / n) along it, with a the angle of an edge.
      const double lambda_min = 2.0 * std::cos(edge_angle) - 2.0;
      for (const CertificateOptions& options :
           {CertificateOptions{}, by_eigenvalue(), by_random_start()}) {
        const Certificate certificate = certify(graph, R, options);
        CHECK(certificate.verdict == Verdict::not_certified);
        CHECK(certificate.gap >= f * (1.0 - 1e-9));  // f* = 0
        if (certificate.method == CertificateMethod::factorization) {
          CHECK(certificate.lambda_min == doctest::Approx(lambda_min).epsilon(1e-6));
        }
      }
      CHECK(certify(graph, test::twisted(n, 0)).verdict == Verdict::proved);
    }
  }
}

TEST_CASE("an estimate does not overlook a twisted cycle that hangs on a graph without noise") {
  // All of S's negative directions lie in the cycle, and an iteration may meet the others first.
  Random random;
  INFO(random.replay());
  constexpr Index n = 200;
  for (const Index c : {6, 12, 50, 300}) {
    for (const double weight : {1.0, 1e-3}) {
      std::vector<RelativeRotation> measurements;
      for (const auto& [i, j] : test::cycle(c)) {
        measurements.push_back({i, j, Matrix3::Identity(), weight});
      }
      for (const auto& [i, j] : test::random_connected(random, n, 4 * n)) {
        measurements.push_back({c + i, c + j});
      }
      measurements.push_back({0, c});
      const MeasurementGraph graph(measurements);
      Rotations R = test::twisted(c, 1);
      R.resize(c + n, Matrix3::Identity());
      const double f = objective(graph, R);
      REQUIRE(f == doctest::Approx(8.0 * weight * c * std::pow(std::sin(pi / c), 2)));
      for (const CertificateOptions& options : {by_eigenvalue(), by_random_start()}) {
        const Certificate certificate = certify(graph, R, options);
        CAPTURE(c);
        CAPTURE(weight);
        CHECK(certificate.verdict == Verdict::not_certified);
        CHECK(certificate.gap >= f * (1.0 - 1e-9));  // f* = 0
      }
    }
  }
}

TEST_CASE("the optimum of a noisy cycle spreads its closing angle evenly, and is proved") {
  Random random;
  INFO(random.replay());
  for (const Index n : {3, 10, 50}) {
    const auto measurements = test::simulate(random, test::cycle(n), 0.2);
    Matrix3 loop = Matrix3::Identity();
    for (const RelativeRotation& m : measurements) loop = loop * m.i_from_j;
    const double angle = log_so3(loop).norm();
    const MeasurementGraph graph(measurements);
    const Rotations R = descend(graph, shortest_path_init(graph));
    CAPTURE(n);
    CHECK(objective(graph, R) == doctest::Approx(4.0 * n * (1.0 - std::cos(angle / n))));
    CHECK(certify(graph, R).verdict == Verdict::proved);
  }
}

TEST_CASE("one wrong component spoils the certificate of all; a node without edges does not") {
  const Index n = 20;
  std::vector<RelativeRotation> measurements;
  std::vector<NodeId> nodes;
  for (const auto& [i, j] : test::cycle(n)) {
    measurements.push_back({i, j});
    measurements.push_back({i + 100, j + 100});
  }
  for (NodeId id = 0; id < n; ++id) nodes.push_back(id);
  nodes.push_back(50);
  for (NodeId id = 100; id < 100 + n; ++id) nodes.push_back(id);
  const MeasurementGraph graph(measurements, nodes);

  const auto together = [&](int first_turns, int second_turns) {
    Rotations R = test::twisted(n, first_turns);
    R.push_back(exp_so3({1.0, 2.0, 3.0}));
    const Rotations second = test::twisted(n, second_turns);
    R.insert(R.end(), second.begin(), second.end());
    return R;
  };
  for (const CertificateOptions& options : {CertificateOptions{}, by_eigenvalue()}) {
    CHECK(certify(graph, together(0, 0), options).verdict == Verdict::proved);
    const Certificate first_wrong = certify(graph, together(1, 0), options);
    const Certificate second_wrong = certify(graph, together(0, 1), options);
    CHECK(first_wrong.verdict == Verdict::not_certified);
    CHECK(second_wrong.verdict == Verdict::not_certified);
    CHECK(first_wrong.lambda_min == doctest::Approx(second_wrong.lambda_min).epsilon(1e-3));
  }
}

TEST_CASE("a common turn of a whole component changes nothing that is certified") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(10), 0.3);
  const Rotations R = descend(graph, shortest_path_init(graph));
  const Matrix3 turn = random.rotation();
  Rotations turned = R;
  for (Matrix3& R_i : turned) R_i = turn * R_i;
  const Certificate one = certify(graph, R), other = certify(graph, turned);
  CHECK(one.verdict == other.verdict);
  CHECK(one.lambda_min == doctest::Approx(other.lambda_min).scale(1e-3));
}

TEST_CASE("gap and verdict follow the unit of the weights") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 10, 20), 0.2);
  const MeasurementGraph graph(measurements);
  const Rotations optimum = descend(graph, shortest_path_init(graph));
  for (const double size : {1e-7, 1e-3, 0.1}) {
    const Rotations R = test::perturbed(random, optimum, size);
    for (const double weight : {std::ldexp(1.0, -60), std::ldexp(1.0, 60)}) {
      for (RelativeRotation& m : measurements) m.weight = weight;
      const MeasurementGraph scaled(measurements);
      for (const CertificateOptions& options :
           {CertificateOptions{}, by_eigenvalue(), by_random_start()}) {
        const Certificate one = certify(graph, R, options);
        const Certificate other = certify(scaled, R, options);
        CAPTURE(size);
        CAPTURE(weight);
        CHECK(other.verdict == one.verdict);
        CHECK(other.relative_gap == doctest::Approx(one.relative_gap).epsilon(1e-3));
        CHECK(other.gap / weight == doctest::Approx(one.gap).epsilon(1e-3));
      }
    }
  }
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

TEST_CASE("wherever the work is stopped the certificate says no more than it knows") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::cycle(30), 0.1);
  const Rotations optimum = descend(graph, shortest_path_init(graph));
  const double best = objective(graph, optimum);
  for (const double size : {0.0, 0.1, 1.0}) {
    const Rotations R = test::perturbed(random, optimum, size);
    const double f = objective(graph, R);
    for (CertificateOptions options : {CertificateOptions{}, by_eigenvalue(), by_random_start()}) {
      const Certificate complete = certify(graph, R, options);
      for (int allowed = 0; allowed < 30; ++allowed) {
        int asked = 0;
        options.keep_going = [&] { return asked++ < allowed; };
        const Certificate certificate = certify(graph, R, options);
        CAPTURE(size);
        CAPTURE(allowed);
        REQUIRE(f - certificate.gap <= best + objective_rounding(graph, best));
        if (complete.verdict == Verdict::not_certified) {
          REQUIRE(certificate.verdict == Verdict::not_certified);
        }
        if (allowed == 0) REQUIRE(certificate.verdict == Verdict::not_certified);
        if (allowed == 0 && complete.method == CertificateMethod::factorization) {
          REQUIRE(certificate.method == CertificateMethod::none);
          REQUIRE(std::isnan(certificate.lambda_min));
          REQUIRE(certificate.gap == doctest::Approx(f).epsilon(1e-12));
        }
      }
    }
  }
}

TEST_CASE("certificates have the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph =
      simulate_graph(random, test::random_connected(random, 600, 60000), 0.2);
  const Rotations R = test::perturbed(random, shortest_path_init(graph), 1e-2);
  for (CertificateOptions options : {by_eigenvalue(), by_random_start()}) {
    options.num_threads = 1;
    const Certificate one = certify(graph, R, options);
    for (const int num_threads : {2, 3, 7}) {
      options.num_threads = num_threads;
      const Certificate other = certify(graph, R, options);
      CHECK(other.method == one.method);
      CHECK(other.gap == one.gap);
      CHECK(other.lambda_min == one.lambda_min);
    }
  }
}

TEST_CASE("matrices that are not rotations are refused: their objective means nothing") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = simulate_graph(random, test::complete(5), 0.3);
  const Rotations optimum = descend(graph, shortest_path_init(graph));
  const auto each = [&](auto&& change) {
    Rotations R = optimum;
    for (Matrix3& R_i : R) R_i = change(R_i);
    return R;
  };
  // Zeros, for one, have the objective 0, below every optimum.
  CHECK_THROWS_AS(certify(graph, each([](const Matrix3&) -> Matrix3 { return Matrix3::Zero(); })),
                  std::invalid_argument);
  CHECK_THROWS_AS(certify(graph, each([](const Matrix3& R) -> Matrix3 { return 0.9 * R; })),
                  std::invalid_argument);
  CHECK_THROWS_AS(certify(graph, each([](const Matrix3& R) -> Matrix3 { return -R; })),
                  std::invalid_argument);
  const double bad = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(certify(graph, each([=](const Matrix3& R) -> Matrix3 { return bad * R; })),
                  std::invalid_argument);
}

TEST_CASE("a wrong number of rotations is refused with both numbers") {
  const MeasurementGraph graph = test::noiseless_cycle(5);
  CHECK_THROWS_WITH_AS(certify(graph, test::twisted(4, 0)),
                       "found 4 rotations; expected 5, one for each node", std::invalid_argument);
}

// Certificates of graphs whose optimum is known, of parts, of other units, and of work cut short.

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>

#include "support/certificates.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::by_eigenvalue;
using rotavg::test::by_random_start;
using rotavg::test::descend;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;

}  // namespace

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

TEST_CASE("however heavy one edge is, it hides nothing that the others say") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::complete(6), 0.1);
  for (const double ratio : {1e12, 1e18, 1e24, 1e30, 1e90}) {
    CAPTURE(ratio);
    measurements[0].weight = ratio;
    const MeasurementGraph graph(measurements);
    Rotations R = shortest_path_init(graph);  // along the heavy edge
    CHECK(certify(graph, R).verdict != Verdict::proved);
    R[5] = exp_so3({1.5, 0.0, 0.0}) * R[5];
    CHECK(certify(graph, R).verdict != Verdict::proved);
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

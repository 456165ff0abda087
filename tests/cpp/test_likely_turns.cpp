#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/robust/likely_turns.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/turn_odds.hpp>

#include "support/graphs.hpp"
#include "support/largest_error.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::largest_error;
using rotavg::test::Random;

namespace {

constexpr double degrees = 3.141592653589793 / 180.0;

/// Cameras that look the same way up to some 25 degrees, and their edges: all true but for those
/// that turn by 70 to 180 degrees about any axis, whatever is true.
struct Views {
  Rotations truth;
  std::vector<RelativeRotation> measurements;

  Views(Random& random, Index n) {
    for (Index i = 0; i < n; ++i) {
      truth.push_back(exp_so3(12.0 * degrees * random.rotation() *
                              Vector3(random.uniform(0.0, 1.0), 0.0, 0.0)));
    }
  }
  void add(Index i, Index j, const Matrix3& i_from_j, double weight = 1.0) {
    RelativeRotation m;
    m.i = i;
    m.j = j;
    m.i_from_j = i_from_j;
    m.weight = weight;
    measurements.push_back(m);
  }
  void add_right(Random& random, Index i, Index j, double noise) {
    add(i, j, truth[i].transpose() * truth[j] * exp_so3(noise * random.normal_vector()));
  }
  void add_wrong(Random& random, Index i, Index j, double weight = 1.0) {
    const double angle = random.uniform(70.0, 180.0) * degrees;
    add(i, j, exp_so3(random.rotation() * Vector3(angle, 0.0, 0.0)), weight);
  }
  /// Every camera up to n with the four next on either side, of which some a wrong edge joins, too.
  void add_ring(Random& random, Index n, double noise) {
    for (Index i = 0; i < n; ++i) {
      for (Index step = 1; step <= 4; ++step) add_right(random, i, (i + step) % n, noise);
      if (i % 2 == 0) add_wrong(random, i, (i + 6) % n);
    }
  }
};

std::vector<double> residuals(const MeasurementGraph& graph, const Rotations& R) {
  std::vector<double> x;
  squared_residuals(graph, to_quaternions(R), 1, x);
  return x;
}

}  // namespace

TEST_CASE("odds are those of two histograms that shrink to one where there is little to count") {
  // Eight edges are right and two are wrong. By 5 degrees turn six of the first, by 100 two of
  // them and both of the others.
  Random random;
  Views views(random, 11);
  for (Index k = 0; k < 10; ++k) {
    views.add(k, k + 1, exp_so3(Vector3(0.0, (k < 6 ? 5.0 : 100.0) * degrees, 0.0)));
  }
  const MeasurementGraph graph(views.measurements);
  std::vector<bool> right(10, true), wrong(10, false);
  for (const std::size_t k : {8, 9}) {
    right[k] = false;
    wrong[k] = true;
  }
  const TurnOdds odds(graph, right, wrong);
  // Ten more of each, six and four of them in the two bins.
  CHECK(odds(0) == doctest::Approx(std::log((12.0 / 18.0) / (6.0 / 12.0))));
  CHECK(odds(9) == doctest::Approx(std::log((6.0 / 18.0) / (6.0 / 12.0))));
  CHECK(odds.turn(0) == doctest::Approx(5.0 * degrees));
  CHECK(odds.turn(9) == doctest::Approx(100.0 * degrees));

  const std::vector<bool> none(10, false);
  const TurnOdds alike(graph, right, right), nothing(graph, none, none);
  for (Index k = 0; k < 10; ++k) {
    CHECK(alike(k) == doctest::Approx(0.0));
    CHECK(nothing(k) == 0.0);
  }
}

TEST_CASE("of two edges at a camera the one that turns as right edges do holds it") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 40;
  constexpr double threshold = 0.01, tolerance = 0.05;
  Views views(random, n + 1);
  views.add_ring(random, n, 0.0);
  const auto held_by = [&](const Matrix3& i_from_j, Index i) {
    Rotations R = views.truth;
    R[n] = R[i] * i_from_j;
    return R;
  };
  views.add_wrong(random, 3, n);
  const Rotations wrong = held_by(views.measurements.back().i_from_j, 3);
  const auto turned = [&](const MeasurementGraph& graph, Rotations& R,
                          const std::vector<double>& precision = {}) {
    return take_likely_turns(graph, precision, residuals(graph, R), threshold, tolerance, R);
  };

  SUBCASE("whichever holds it") {
    views.add_right(random, 20, n, 0.0);
    const MeasurementGraph graph(views.measurements);
    Rotations R = wrong;
    CHECK(turned(graph, R) == 1);
    CHECK(largest_error(R, views.truth) < 1e-6);
    CHECK(turned(graph, R) == 0);
    CHECK(largest_error(R, views.truth) < 1e-6);
  }
  SUBCASE("but not against an edge that is trusted") {
    views.add_right(random, 20, n, 0.0);
    const MeasurementGraph graph(views.measurements);
    std::vector<double> precision(views.measurements.size(), 1.0);
    precision[views.measurements.size() - 2] = 0.0;
    Rotations R = wrong;
    CHECK(turned(graph, R, precision) == 0);
  }
  SUBCASE("nor against another that agrees with it but for noise") {
    views.add_right(random, 20, n, 0.0);
    const Matrix3 alike = wrong[5].transpose() * wrong[n] * exp_so3(Vector3(0.0, 0.0, 0.03));
    views.add(5, n, alike);
    const MeasurementGraph graph(views.measurements);
    Rotations R = wrong;
    CHECK(turned(graph, R) == 0);
  }
  SUBCASE("and of three that are all wrong, the one that turns least") {
    const Vector3 axis = random.rotation() * Vector3::UnitX();
    views.measurements.pop_back();
    views.add(3, n, exp_so3(170.0 * degrees * axis));
    views.add(4, n, exp_so3(85.0 * degrees * axis));
    views.add(20, n, exp_so3(-120.0 * degrees * axis));
    const MeasurementGraph graph(views.measurements);
    Rotations R = held_by(views.measurements[views.measurements.size() - 3].i_from_j, 3);
    CHECK(turned(graph, R) == 1);
    CHECK(residuals(graph, R)[views.measurements.size() - 2] < 1e-12);
    CHECK(turned(graph, R) == 0);
  }
}

TEST_CASE("where wrong edges turn as right ones do, turns say nothing") {
  Random random;
  INFO(random.replay());
  // Rotations drawn at random, and edges that are wrong at random.
  constexpr Index n = 200;
  Views views(random, n + 1);
  views.truth = random.rotations(n + 1);
  for (Index i = 0; i < n; ++i) {
    for (Index step = 1; step <= 8; ++step) views.add_right(random, i, (i + step) % n, 0.0);
    for (Index step = 9; step <= 16; ++step) views.add(i, (i + step) % n, random.rotation());
  }
  views.add_right(random, 3, n, 0.0);
  views.add(20, n, views.truth[3].transpose() * views.truth[n]);  // that turns as far
  const MeasurementGraph graph(views.measurements);
  Rotations R = views.truth;
  CHECK(take_likely_turns(graph, {}, residuals(graph, R), 0.01, 0.05, R) == 0);
}

TEST_CASE("cameras that a right and a wrong edge hold are right, however heavy the wrong one is") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 60, hanging = 12;
  Views views(random, n + hanging);
  views.add_ring(random, n, 0.002);
  for (Index k = 0; k < hanging; ++k) {
    views.add_right(random, 5 * k, n + k, 0.002);
    views.add_wrong(random, 5 * k + 2, n + k, k % 2 == 0 ? 10.0 : 1.0);
  }
  SolveOptions options;
  options.certify = false;
  const MeasurementGraph graph(views.measurements);
  const RobustSolution solution = solve_robust(graph, options);
  CHECK(largest_error(solution.rotations, views.truth) < 0.05);
  CHECK(solution.reason.find("turned as likely edges say") != std::string::npos);
  // No other loss asks how far edges turn, and from a given start none is moved.
  RobustOptions robust;
  robust.loss = Loss::cauchy;
  const RobustSolution other = solve_robust(graph, options, robust);
  CHECK(other.reason.find("turned as") == std::string::npos);
  CHECK(largest_error(other.rotations, views.truth) > 0.5);
}

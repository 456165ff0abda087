#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/online/closing.hpp>
#include <rotavg/online/online.hpp>
#include <rotavg/online/optimum.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/online.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// A graph whose optimum is kept, by its parts.
struct Kept {
  TendedCore tended;
  OnlineOptimum optimum{tended, 1e-10, 1e-6, 1e-10};
  std::vector<RelativeRotation> measurements;

  explicit Kept(Index num_nodes) {
    for (Index i = 0; i < num_nodes; ++i) tended.add_node(i);
  }
  OnlineEdge edge(const RelativeRotation& m) const {
    OnlineEdge e;
    e.i_from_j = check_measurement(0, m);
    e.i = static_cast<Index>(m.i);
    e.j = static_cast<Index>(m.j);
    e.given = m.weight;
    return e;
  }
  void add(const RelativeRotation& m) {
    OnlineEdge e = edge(m);
    e.weight = e.given;
    tended.use(tended.core.graph().add_edge(e));
    optimum.settle(/*may_wait=*/false);
    measurements.push_back(m);
  }
};

}  // namespace

TEST_CASE(
    "what closing a cycle costs is foretold: no more than it does, and no less if it is small") {
  Random random;
  INFO(random.replay());
  const Index n = 40;
  for (int trial = 0; trial < 6; ++trial) {
    const double noise = trial % 2 == 0 ? 0.0 : 0.02;
    Kept kept(n + 12);
    auto measurements = test::simulate(random, test::random_connected(random, n, 25), noise);
    test::spread_weights(random, trial % 3, measurements);
    // Twelve nodes that hang in trees.
    for (Index i = n; i < n + 12; ++i) {
      measurements.push_back({random.below(i), i, random.rotation(), random.power_of_ten(-1, 1)});
    }
    for (const RelativeRotation& m : measurements) kept.add(m);
    const double f = solve(MeasurementGraph(kept.measurements)).objective;
    for (int k = 0; k < 20; ++k) {
      const Index i = random.below(n + 12), j = random.below(n + 12);
      if (i == j) continue;
      const auto R = [&](Index l) { return kept.tended.core.rotation(l).toRotationMatrix(); };
      const bool is_small = k % 2 == 0;
      const double angle = is_small ? 1e-3 : random.uniform(0.2, 3.0);
      const Matrix3 measured = R(i).transpose() * R(j) * exp_so3(angle * random.direction());
      const RelativeRotation m{i, j, measured, random.power_of_ten(-1, 1)};
      const std::optional<Closing> closing = kept.optimum.foretell(kept.edge(m));
      REQUIRE(closing.has_value());
      auto with = kept.measurements;
      with.push_back(m);
      const MeasurementGraph graph(with);
      const Solution best = solve(graph);
      const double rises = best.objective - f;
      CAPTURE(i);
      CAPTURE(j);
      CAPTURE(angle);
      CHECK(closing->least_cost <= rises * (1.0 + 1e-6) + 1e-9 * f + 1e-14);
      if (!is_small || noise > 0.0) continue;
      CHECK(closing->least_cost >= 0.99 * rises);
      const std::vector<double> squares = squared_residuals(graph, best.rotations, 1);
      CHECK(closing->squared_chord == doctest::Approx(squares.back()).epsilon(0.01));
    }
  }
}

TEST_CASE("nothing is foretold of a factor that held more firmly") {
  Random random;
  INFO(random.replay());
  Kept kept(30);
  for (const auto& m : test::simulate(random, test::cycle(10), 0.05)) kept.add(m);
  auto others = test::simulate(random, test::cycle(10), 0.05);
  for (RelativeRotation& m : others) m.i += 10, m.j += 10;
  for (const RelativeRotation& m : others) kept.add(m);
  const OnlineEdge across = kept.edge({2, 15, random.rotation()});
  const OnlineEdge within = kept.edge({2, 7, random.rotation()});
  CHECK(kept.optimum.foretell(within).has_value());
  OnlineEdge bridge = kept.edge({0, 13, random.rotation()});
  bridge.weight = bridge.given;
  kept.tended.use(kept.tended.core.graph().add_edge(bridge));
  CHECK_FALSE(kept.optimum.foretell(across).has_value());
  kept.optimum.settle(/*may_wait=*/false);
  CHECK(kept.optimum.foretell(across).has_value());
  kept.tended.set_weight(0, 0.1);
  CHECK_FALSE(kept.optimum.foretell(within).has_value());
  kept.optimum.settle(/*may_wait=*/false);
  kept.tended.drop(3, /*for_good=*/true);
  CHECK_FALSE(kept.optimum.foretell(within).has_value());
}

TEST_CASE("a wrong closure costs nothing where it is proved to be dear") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.2;
  for (const double tolerance : {1e-10, 1e-2}) {
    options.tolerance = tolerance;
    Online online(options);
    online.add(test::simulate(random, test::grid(8, 8), 0.01));
    for (int k = 0; k < 20; ++k) {
      const Matrix3 turned = exp_so3(random.uniform(2.0, 3.0) * random.direction());
      const Index i = random.below(32), j = 32 + random.below(32);
      const Matrix3 R = online.rotation(i).transpose() * online.rotation(j) * turned;
      const Index number = online.add({{i, j, R}}).front();
      CHECK(online.edge_weights()[number] == 0.0);
      CHECK(online.state().iterations == 0);
      CHECK(online.state().eliminated == 0);
    }
    CHECK(online.state().num_outliers == 20);
    test::check_against_solve(online, tolerance > 1e-9 ? 0.011 : 1e-9);
  }
}

TEST_CASE("closures of one call that agree with each other are judged as if they came one by one") {
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.2;
  options.second_opinions = false;
  const auto turn = [](double angle) { return exp_so3({angle, 0.0, 0.0}); };
  for (const bool at_once : {true, false}) {
    Online online(options);
    for (Index i = 0; i < 7; ++i) online.add({{i, i + 1, Matrix3::Identity(), 7.0}}, {true});
    online.add({{7, 0, turn(0.01), 0.01}}, {true});
    const RelativeRotation first{0, 7, turn(0.2476), 1.04}, second{0, 7, turn(0.3508), 2.02};
    if (at_once) {
      online.add({first, second});
    } else {
      online.add({first});
      online.add({second});
    }
    CHECK(online.state().num_outliers == 0);
    CHECK(online.edge_weights().back() == 2.02);
  }
}

TEST_CASE("a loose tolerance leaves out no closure before anything has moved") {
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.2;
  options.second_opinions = false;
  options.tolerance = 0.01;
  const auto turn = [](double angle) { return exp_so3({angle, 0.0, 0.0}); };
  Online online(options);
  online.add({{0, 1, turn(0.05), 4e3}, {0, 1, turn(-0.05), 4e3}});
  for (Index i = 1; i < 20; ++i) online.add({{i, i + 1, Matrix3::Identity()}}, {true});
  online.add({{20, 1, turn(0.02)}}, {true});
  online.add({{1, 11, turn(0.25)}});
  CHECK(online.edge_weights().back() == 1.0);
  CHECK(online.state().num_outliers == 0);
}

#include <algorithm>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/online/online.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/online.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::check_against_solve;
using rotavg::test::Random;
using rotavg::test::used;

namespace {

/// Whether the last step was put off, though the graph's cost has changed.
bool has_waited(const Online& online, double objective_before) {
  return online.state().objective != objective_before && online.state().eliminated == 0 &&
         online.state().iterations == 0;
}

}  // namespace

TEST_CASE("what is proved to gain less than the tolerance waits") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.tolerance = 0.03;
  const double of_best = options.tolerance / (1.0 - options.tolerance);
  for (const double noise : {0.01, 0.1}) {
    const auto measurements = test::simulate(random, test::grid(9, 9), noise);
    Online online(options), strict;
    Index moved = 0, all_moved = 0;
    int waited = 0;
    for (const RelativeRotation& m : measurements) {
      const double before = online.state().objective;
      online.add({m});
      strict.add({m});
      check_against_solve(online, of_best);
      CHECK(online.state().relative_gap <= options.tolerance);
      moved += online.state().moved;
      all_moved += strict.state().moved;
      waited += has_waited(online, before);
    }
    CHECK(waited > 2);  // of 64 that close a cycle
    CHECK(2 * moved < all_moved);
  }
}

TEST_CASE("what waits is not forgotten") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.tolerance = 0.3;
  const double of_best = options.tolerance / (1.0 - options.tolerance);
  const auto part = [&](Index first) {
    auto measurements = test::simulate(random, test::grid(6, 6), 0.05);
    for (RelativeRotation& m : measurements) m.i += first, m.j += first;
    return measurements;
  };
  int waited = 0;
  for (int trial = 0; trial < 5; ++trial) {
    Online online(options);
    const auto add = [&](const std::vector<RelativeRotation>& edges) {
      const double before = online.state().objective;
      const std::vector<Index> numbers = online.add(edges);
      waited += has_waited(online, before);
      check_against_solve(online, of_best);
      CHECK(online.state().relative_gap <= options.tolerance);
      return numbers;
    };
    const auto set_weight = [&](Index edge, double weight) {
      const double before = online.state().objective;
      online.set_weights({edge}, {weight});
      waited += has_waited(online, before);
      check_against_solve(online, of_best);
    };
    const auto first = part(0), second = part(100);
    online.add(first);
    online.add(second);
    const auto again = [&](const RelativeRotation& m) {
      RelativeRotation other = m;
      other.i_from_j = m.i_from_j * exp_so3(0.05 * random.normal_vector());
      return other;
    };
    // In both parts something waits, one goes and comes back, and an edge joins the two.
    const Index closing = add({again(first[7])}).front();
    add({again(second[9])});
    set_weight(closing, 0.0);
    set_weight(closing, 1.0);
    const Index bridge = add({{3, 103, random.rotation()}}).front();
    add({again(first[20]), again(second[30])});
    add({{10, 110,
          online.rotation(10).transpose() * online.rotation(110) *
              exp_so3(0.02 * random.normal_vector())}});
    online.remove({closing});
    check_against_solve(online, of_best);
    add({again(first[2])});
    online.remove({bridge});
    check_against_solve(online, of_best);
    // A whole row of the first part's grid goes, and the part falls in two.
    std::vector<Index> cut;
    for (Index k = 0; k < static_cast<Index>(first.size()); ++k) {
      if (first[k].i < 18 && first[k].j >= 18) cut.push_back(k);
    }
    add({again(first[0])});
    online.remove(cut);
    check_against_solve(online, of_best);
  }
  CHECK(waited > 5);
}

TEST_CASE("steps of one component leave the others where they are") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.tolerance = 0.5;
  for (int trial = 0; trial < 10; ++trial) {
    Online online(options);
    online.add(test::simulate(random, test::random_connected(random, 10, 10), 0.3));
    std::vector<Matrix3> before;
    for (NodeId i = 0; i < 10; ++i) before.push_back(online.rotation(i));
    auto others = test::simulate(random, test::random_connected(random, 10, 10), 0.3);
    for (RelativeRotation& m : others) m.i += 50, m.j += 50;
    online.add(others);
    CHECK(online.state().iterations > 0);
    for (NodeId i = 0; i < 10; ++i) CHECK(online.rotation(i) == before[i]);
  }
}

TEST_CASE("steps of one component leave what is known of the others true") {
  Random random;
  INFO(random.replay());
  for (int trial = 0; trial < 60; ++trial) {
    OnlineOptions options;
    options.tolerance = trial % 2 == 0 ? 0.01 : 0.8;
    Online online(options);
    const double noise = trial % 3 == 0 ? 0.05 : 1.0;
    auto edges = test::simulate(random, test::random_connected(random, 6, 8), noise);
    auto others = test::simulate(random, test::random_connected(random, 6, 3), noise);
    for (RelativeRotation& m : others) m.i += 50, m.j += 50;
    edges.insert(edges.end(), others.begin(), others.end());
    if (trial % 4 == 0) std::shuffle(edges.begin(), edges.end(), random.generator());
    for (const RelativeRotation& m : edges) {
      online.add({m});
      const double f = online.state().objective;
      const double best = solve(MeasurementGraph(used(online), online.nodes())).objective;
      CHECK(f - online.state().gap <= best * (1.0 + 1e-9) + 1e-20);
      if (noise < 0.1) CHECK(online.state().relative_gap <= options.tolerance);
    }
  }
}

TEST_CASE("with a robust loss closures wait, unless it would change a weight") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.3;
  options.tolerance = 0.1;
  const Index n = 200;
  const Rotations truth = random.rotations(n);
  {  // Poses that come one by one, with closures that agree.
    Online online(options);
    int waited = 0;
    const auto path = test::measure(random, test::path(n), truth, 0.01);
    for (Index i = 1; i < n; ++i) {
      const double before = online.state().objective;
      online.add({path[i - 1]}, {true});
      CHECK(online.state().eliminated == 0);
      if (i > 20) online.add(test::measure(random, {{i - 20, i}}, truth, 0.01));
      waited += has_waited(online, before);
    }
    CHECK(waited > 20);
    CHECK(online.state().num_outliers == 0);
  }
  options.tolerance = 0.5;
  Online online(options);
  online.add(test::measure(random, test::path(n), truth, 0.05), std::vector<bool>(n - 1, true));
  // Odometry has drifted by more than the scale, and the closures are right.
  test::Pairs pairs;
  for (Index k = 0; k < 20; ++k) pairs.push_back({k, n - 1 - k});
  for (const RelativeRotation& m : test::measure(random, pairs, truth, 0.01)) online.add({m});
  CHECK(online.state().num_outliers == 0);
  online.add({{5, n - 7, truth[5].transpose() * truth[n - 7] * exp_so3({1.0, 0.0, 0.0})}});
  CHECK(online.state().num_outliers == 1);
}

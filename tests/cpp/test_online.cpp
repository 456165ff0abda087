#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/components.hpp>
#include <rotavg/online/online.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/online.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::check_against_solve;
using rotavg::test::Random;
using rotavg::test::used;

TEST_CASE("edges that close no cycle are met, cost nothing and stay proved") {
  Random random;
  INFO(random.replay());
  Online online;
  CHECK(online.state().verdict == Verdict::proved);
  const auto measurements = test::simulate(random, test::random_connected(random, 60, 0), 0.5);
  for (const RelativeRotation& m : measurements) {
    online.add({m});
    CHECK(online.state().verdict == Verdict::proved);
    CHECK(online.state().eliminated == 0);
    CHECK(online.state().objective <= 1e-20);
  }
  CHECK(online.state().num_components == 1);
  const Rotations R = online.rotations();
  const MeasurementGraph graph(measurements, online.nodes());
  CHECK(objective(graph, R) < 1e-20);
}

TEST_CASE("after every edge the optimum is that of solve()") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 6; ++k) {
    const double noise = random.power_of_ten(-3.0, -0.7);
    auto pairs = k % 2 == 0 ? test::grid(5, 6) : test::random_connected(random, 25, 25);
    if (k > 3) std::shuffle(pairs.begin(), pairs.end(), random.generator());  // components join
    auto measurements = test::simulate(random, pairs, noise);
    test::spread_weights(random, k % 3, measurements);
    Online online;
    for (const RelativeRotation& m : measurements) {
      online.add({m});
      check_against_solve(online);
    }
  }
}

TEST_CASE("edges come, go, and change their weights") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 4; ++k) {
    const auto measurements =
        test::simulate(random, test::random_connected(random, 16, 20), k % 2 == 0 ? 0.05 : 0.002);
    Online online;
    std::vector<Index> there;
    for (int step = 0; step < 80; ++step) {
      const double what = random.uniform(0.0, 1.0);
      if (there.empty() || what < 0.5) {
        const auto& m = measurements[random.below(static_cast<Index>(measurements.size()))];
        there.push_back(online.add({m}).front());
      } else if (what < 0.7) {
        const Index p = random.below(static_cast<Index>(there.size()));
        online.remove({there[p]});
        there.erase(there.begin() + p);
      } else {
        const Index p = random.below(static_cast<Index>(there.size()));
        const double weight = random.coin() ? 0.0 : random.power_of_ten(-1.0, 1.0);
        online.set_weights({there[p]}, {weight});
      }
      check_against_solve(online);
    }
    online.remove(there);
    check_against_solve(online);
    CHECK(online.state().num_components == online.state().num_nodes);
  }
}

TEST_CASE("whole graphs at once, parallel edges and a node with very many") {
  Random random;
  INFO(random.replay());
  {
    Online online;
    online.add(test::simulate(random, test::grid(12, 12), 0.1));
    check_against_solve(online);
  }
  {
    Online online;
    test::Pairs pairs = test::path(3);
    for (int k = 0; k < 30; ++k) pairs.push_back({0, 2});
    for (const auto& m : test::simulate(random, pairs, 0.1)) online.add({m});
    check_against_solve(online);
  }
  {
    Online online;
    const Index n = 300;
    test::Pairs pairs = test::path(n);
    for (Index i = 2; i < n; ++i) pairs.push_back({0, i});
    const auto measurements = test::simulate(random, pairs, 0.05);
    online.add({measurements.begin(), measurements.begin() + n - 1});
    for (auto m = measurements.begin() + n - 1; m != measurements.end(); ++m) online.add({*m});
    check_against_solve(online);
  }
}

TEST_CASE("a long loop that closes with a large error") {
  Random random;
  INFO(random.replay());
  const Index n = 2000;
  auto measurements = test::simulate(random, test::path(n), 0.02);
  Online online;
  online.add(measurements);
  const Matrix3 far = online.rotation(n - 1);
  online.add({{0, n - 1, far * exp_so3({0.3, -0.8, 0.5})}});
  check_against_solve(online);
  CHECK(online.state().verdict == Verdict::proved);
  online.add({{n / 2, n - 1, online.rotation(n / 2).transpose() * online.rotation(n - 1)}});
  check_against_solve(online);
}

TEST_CASE("however heavy one edge is, it hides nothing that the others say") {
  Random random;
  INFO(random.replay());
  const auto measurements = test::simulate(random, test::random_connected(random, 8, 12), 0.1);
  const double f = solve(MeasurementGraph(measurements)).objective;
  for (const double ratio : {1e6, 1e12, 1e20, 1e30, 1e90}) {
    CAPTURE(ratio);
    Online online;
    online.add(measurements);
    // Met exactly, but for rounding.
    online.add(
        {{0, 100, exp_so3({0.0, 0.0, 0.3}), ratio}, {0, 100, exp_so3({0.0, 0.0, 0.3}), ratio}});
    online.set_weights({0}, {2.0});
    online.set_weights({0}, {1.0});
    if (online.state().verdict == Verdict::proved) CHECK(online.state().gap <= 1e-5 * f);
    if (ratio < 1e7) CHECK(online.state().verdict == Verdict::proved);
  }
}

TEST_CASE("weights too far apart for a factor are left to solve()") {
  for (const double light : {1e-3, 1e-8, 1e-9, 1e-12, 1e-15, 1e-30}) {
    CAPTURE(light);
    Online online;
    online.add({{7, 8, Matrix3::Identity()},
                {8, 9, Matrix3::Identity()},
                {7, 9, exp_so3({0.1, 0.0, 0.0})}});
    online.add({{0, 1, Matrix3::Identity(), light}});
    online.add({{1, 2, Matrix3::Identity(), 1.0}});
    online.add({{0, 2, exp_so3({0.0, 0.0, 0.5}), light}});
    const auto check = [&] {
      const MeasurementGraph graph(used(online), online.nodes());
      const Solution best = solve(graph);
      const double f = objective(graph, online.rotations());
      CHECK(f <= best.objective * (1.0 + 1e-9));
      CHECK(f - online.state().gap <= best.objective * (1.0 + 1e-9));
    };
    check();
    online.add({{7, 9, exp_so3({0.0, 0.2, 0.0})}});  // elsewhere
    check();
    online.add({{2, 3, Matrix3::Identity()}, {1, 3, exp_so3({0.0, 0.3, 0.0})}});
    check();
    online.set_weights({3, 5}, {1.0, 1.0});  // together again
    check();
    CHECK(online.state().verdict == Verdict::proved);
  }
}

TEST_CASE("what is removed leaves nothing of its cost in the objective") {
  Random random;
  INFO(random.replay());
  for (const double tolerance : {1e-10, 1e-2, 0.5}) {
    OnlineOptions options;
    options.tolerance = tolerance;
    for (int trial = 0; trial < 10; ++trial) {
      Online online(options);
      online.add(test::simulate(random, test::random_connected(random, 8, 8), 1e-8));
      const auto wrong = online.add({{0, 5, random.rotation(), random.power_of_ten(0.0, 6.0)}});
      online.remove(wrong);
      const MeasurementGraph graph(used(online), online.nodes());
      const double f = objective(graph, online.rotations());
      CHECK(std::abs(online.state().objective - f) <= 1e-6 * f + 1e-20);
    }
  }
}

TEST_CASE("nodes without edges, and components that meet") {
  Random random;
  INFO(random.replay());
  Online online;
  online.add({}, {}, {5, 3, 5});
  CHECK(online.state().num_nodes == 2);
  CHECK(online.state().num_components == 2);
  CHECK(online.rotation(3) == Matrix3::Identity());
  const auto first = test::simulate(random, test::cycle(8), 0.05);
  auto second = test::simulate(random, test::grid(4, 4), 0.05);
  for (RelativeRotation& m : second) m.i += 100, m.j += 100;
  online.add(first);
  online.add(second);
  check_against_solve(online);
  online.add({{3, 103, random.rotation()}});  // a bridge costs nothing
  check_against_solve(online);
  const auto closing = online.add({{0, 115, random.rotation()}});
  check_against_solve(online);
  online.remove(closing);
  check_against_solve(online);
}

TEST_CASE("wrong closures are left out, and pardoned where others agree with them") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.3;
  Online online(options);
  const auto pairs = test::grid(6, 6);
  const Rotations truth = random.rotations(36);
  std::vector<RelativeRotation> path, closures;
  for (const RelativeRotation& m : test::measure(random, pairs, truth, 0.01)) {
    (m.j == m.i + 1 ? path : closures).push_back(m);
  }
  path.push_back({0, 6, truth[0].transpose() * truth[6]});  // rows are joined, too
  for (Index r = 1; r + 1 < 6; ++r) {
    path.push_back({6 * r, 6 * r + 6, truth[6 * r].transpose() * truth[6 * r + 6]});
  }
  online.add(path, std::vector<bool>(path.size(), true));
  std::vector<Index> wrong;
  for (std::size_t k = 0; k < closures.size(); ++k) {
    online.add({closures[k]});
    if (k % 4 != 0) continue;
    RelativeRotation m = closures[k];
    m.i_from_j *= exp_so3(random.uniform(1.0, 3.0) * random.direction());
    wrong.push_back(online.add({m}).front());
  }
  const auto weights = online.edge_weights();
  for (std::size_t k = 0; k < weights.size(); ++k) {
    const bool is_wrong = std::count(wrong.begin(), wrong.end(), static_cast<Index>(k)) > 0;
    CHECK((weights[k] == 0.0) == is_wrong);
  }
  CHECK(online.state().num_outliers == static_cast<Index>(wrong.size()));
  CHECK(online.state().verdict == Verdict::proved);

  // The first closure of a loop is believed; once two others contradict it, it is not, and where
  // these go, it comes back.
  Online loop(options);
  const Rotations R = random.rotations(12);
  loop.add(test::measure(random, test::path(12), R, 0.001), std::vector<bool>(11, true));
  const auto closing = [&](Index i, Index j, double error) {
    return RelativeRotation{i, j, R[i].transpose() * R[j] * exp_so3({error, 0.0, 0.0})};
  };
  const Index first = loop.add({closing(0, 11, 1.0)}).front();
  CHECK(loop.edge_weights()[first] == 1.0);
  const auto others = loop.add({closing(0, 10, 0.0), closing(1, 11, 0.0), closing(0, 11, 0.0)});
  CHECK(loop.edge_weights()[first] == 0.0);
  CHECK(loop.state().num_outliers == 1);
  loop.remove(others);
  loop.set_weights({first}, {1.0});
  CHECK(loop.state().num_edges >= 11);
}

TEST_CASE("what was left out comes back where nothing checks it any more") {
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.1;
  const auto turn = [](double angle) { return exp_so3({0.0, 0.0, angle}); };

  Online parted(options);
  const Index right = parted.add({{0, 2, turn(0.0)}}, {false}).front();
  const Index odometry = parted.add({{1, 0, turn(0.0)}}, {true}).front();
  parted.add({{1, 2, turn(1.0)}}, {true});
  CHECK(parted.edge_weights()[right] == 0.0);
  parted.remove({odometry});
  CHECK(parted.edge_weights()[right] == 1.0);
  CHECK(parted.state().num_components == 1);
  CHECK(parted.state().num_outliers == 0);

  // Two parts, an edge between them that agrees with the only other one, and one that does not.
  Online joined(options);
  joined.add({{0, 1, turn(0.0)}, {2, 3, turn(0.0)}}, {true, true});
  const Index bridge = joined.add({{1, 2, turn(0.0)}}, {true}).front();
  const Index agrees = joined.add({{0, 3, turn(0.001)}}, {false}).front();
  const Index wrong = joined.add({{0, 2, turn(1.0)}}, {false}).front();
  CHECK(joined.edge_weights()[wrong] == 0.0);
  joined.remove({bridge, agrees});
  CHECK(joined.edge_weights()[wrong] == 1.0);
  const auto back = joined.add({{1, 2, turn(0.0)}, {0, 3, turn(0.001)}}, {false, false});
  CHECK(joined.edge_weights()[wrong] == 0.0);
  for (const Index k : back) CHECK(joined.edge_weights()[k] == 1.0);
}

TEST_CASE("bad input is refused, and changes nothing") {
  Online online;
  const Matrix3 I = Matrix3::Identity();
  const auto edges = online.add({{1, 2, I}, {2, 3, I}, {1, 3, I}});
  const auto refused = [&](auto&& f) {
    CHECK_THROWS_AS(f(), std::invalid_argument);
    CHECK(online.state().num_nodes == 3);
    CHECK(online.state().num_edges == 3);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused([&] { online.add({{7, 8, I}, {4, 4, I}}); });
  refused([&] { online.add({{7, 8, I, -1.0}}); });
  refused([&] { online.add({{7, 8, I, nan}}); });
  refused([&] { online.add({{7, 8, nan * I}}); });
  refused([&] { online.add({{7, 8, -I}}); });
  refused([&] { online.add({{7, 8, I}}, {true, false}); });
  refused([&] { online.remove({edges[0], edges[0]}); });
  refused([&] { online.remove({17}); });
  refused([&] { online.set_weights({edges[0]}, {nan}); });
  refused([&] { online.set_weights({edges[0], edges[1]}, {1.0}); });
  refused([&] { online.rotation(99); });
  online.remove({edges[0]});
  CHECK_THROWS_AS(online.remove({edges[0]}), InvalidEdge);
  CHECK_THROWS_AS(Online(OnlineOptions{1e-5, 1e-6, Loss::tls, 0.0}), std::invalid_argument);
  for (const double tolerance : {0.0, -1.0, 1.0, nan}) {
    CHECK_THROWS_AS(Online(OnlineOptions{tolerance}), std::invalid_argument);
  }
}

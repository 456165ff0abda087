#include <algorithm>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/online/online.hpp>
#include <rotavg/so3/lie.hpp>

#include "support/graphs.hpp"
#include "support/online.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

TEST_CASE("those that came first are not believed against more that agree") {
  Random random;
  INFO(random.replay());
  for (const Loss loss : {Loss::tls, Loss::geman_mcclure, Loss::cauchy}) {
    for (int trial = 0; trial < 3; ++trial) {
      CAPTURE(static_cast<int>(loss));
      OnlineOptions options;
      options.loss = loss;
      options.loss_scale = 0.15;
      Online online(options);
      const Index n = 240;
      const Rotations truth = random.rotations(n);
      const auto measured = [&](Index i, Index j, const Matrix3& error) {
        return RelativeRotation{i, j, truth[i].transpose() * truth[j] * error};
      };
      const auto noise = [&] { return exp_so3(0.01 * random.normal_vector()); };
      for (Index i = 1; i < n; ++i) online.add({measured(i - 1, i, noise())}, {true});
      // Three that agree, as two places do that look alike; then right ones.
      const Matrix3 turn = exp_so3(random.uniform(1.2, 1.8) * random.direction());
      std::vector<Index> wrong, right;
      for (Index i = 40; i < 43; ++i) {
        const Matrix3 R = truth[i].transpose() * turn * truth[n - i] * noise();
        wrong.push_back(online.add({{i, n - i, R}}).front());
      }
      if (loss == Loss::tls) CHECK(online.state().num_outliers == 0);
      int asked = 0;
      for (int k = 0; k < 40; ++k) {
        const Index i = random.below(n / 3), j = n - 1 - random.below(n / 3);
        right.push_back(online.add({measured(i, j, noise())}).front());
        asked += online.state().num_second_opinions;
      }
      CHECK(asked > 0);
      const std::vector<double> weights = online.edge_weights();
      for (const Index k : wrong) CHECK(weights[k] < 0.1);
      for (const Index k : right) CHECK(weights[k] > 0.5);
      CHECK(online.state().verdict == Verdict::proved);
    }
  }
}

TEST_CASE("nodes without edges, and components without outliers, are not asked about") {
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.1;
  Online online(options);
  const auto turn = [](double angle) { return exp_so3({0.0, 0.0, angle}); };
  online.add({{0, 1, turn(0.1)}, {1, 2, turn(0.1)}}, {true, true}, {99});
  online.add({{50, 51, turn(0.3)}, {51, 52, turn(0.3)}}, {true, true});
  const Index wrong = online.add({{0, 2, turn(2.0)}}).front();
  CHECK(online.edge_weights()[wrong] == 0.0);
  CHECK(online.state().num_second_opinions == 1);
  CHECK(online.state().num_outliers == 1);
  CHECK(online.state().num_components == 3);
  CHECK(online.state().verdict == Verdict::proved);
}

TEST_CASE("of the edges of one call odometry counts first, in whatever order they stand") {
  Random random;
  INFO(random.replay());
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.1;
  std::vector<RelativeRotation> edges{{0, 5, exp_so3({0.0, 0.0, 2.0})}};
  for (Index i = 0; i < 5; ++i) edges.push_back({i, i + 1, Matrix3::Identity()});
  edges.push_back({1, 4, exp_so3({0.0, 0.0, 0.01})});
  for (int k = 0; k < 5; ++k) {
    std::shuffle(edges.begin(), edges.end(), random.generator());
    std::vector<bool> trusted;
    for (const RelativeRotation& m : edges) trusted.push_back(m.j == m.i + 1);
    Online online(options);
    online.add(edges, trusted);
    const std::vector<double> weights = online.edge_weights();
    for (std::size_t e = 0; e < edges.size(); ++e) {
      CHECK(weights[e] == (edges[e].j == 5 && edges[e].i == 0 ? 0.0 : 1.0));
    }
  }
}

TEST_CASE("they can be switched off") {
  OnlineOptions options;
  options.loss = Loss::tls;
  options.loss_scale = 0.1;
  for (const bool on : {true, false}) {
    options.second_opinions = on;
    Online online(options);
    const auto turn = [](double angle) { return exp_so3({0.0, 0.0, angle}); };
    for (Index i = 0; i < 4; ++i) online.add({{i, i + 1, turn(0.0)}}, {true});
    int asked = 0;
    for (int k = 0; k < 8; ++k) {
      online.add({{0, 4, turn(1.0 + 0.2 * k)}});
      asked += online.state().num_second_opinions;
    }
    CHECK((asked > 0) == on);
    CHECK(online.state().num_outliers == 8);
  }
}

TEST_CASE("what solve() moves, and what hangs from nodes that move, is judged anew") {
  const auto turn = [](double angle) { return exp_so3({angle, 0.0, 0.0}); };
  const Matrix3 I = Matrix3::Identity();
  OnlineOptions options;
  options.loss = Loss::tls;
  options.second_opinions = false;
  {
    // Five edges of two nodes, two against three by half a turn: no step leads from one to the
    // other.
    options.loss_scale = 0.7;
    Online online(options);
    const Matrix3 half = exp_so3({0.0, 0.0, 3.141592653589793});
    online.add({{1, 0, I}, {0, 1, I}});
    online.add({{0, 1, half}, {1, 0, half}, {0, 1, half}});
    CHECK(online.state().num_outliers == 2);
    CHECK(online.state().objective < 1e-20);
  }
  {
    options.loss_scale = 0.2;
    Online online(options);
    for (Index i = 0; i < 9; ++i) online.add({{i, i + 1, I, 10.0}});
    online.add({{9, 0, turn(0.1), 10.0}}, {true});
    online.add({{0, 30, I}, {5, 20, I}}, {true, true});  // 30 and 20 hang
    const Index between = online.add({{30, 20, turn(0.8)}}).front();
    CHECK(online.edge_weights()[between] == 0.0);
    online.add({{0, 5, turn(0.8), 1e4}}, {true});
    CHECK(online.edge_weights()[between] == 1.0);
  }
}

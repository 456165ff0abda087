// What cycles check: edges in series, bridges and what hangs on them, under a robust loss.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/checked_part.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/solve_robust.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr Loss all_losses[] = {Loss::automatic, Loss::huber,         Loss::l1,
                               Loss::l_half,    Loss::geman_mcclure, Loss::tls};

}  // namespace

TEST_CASE("series are edges that no cycle separates; bridges are in none") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 40; ++repeat) {
    const Index n = 2 + random.below(10);
    const auto measurements =
        test::simulate(random, test::random_connected(random, n, random.below(n)), 0.0);
    const MeasurementGraph graph(measurements);
    const Series series = series_of(graph);
    const std::vector<bool> is_bridge = bridges(graph);
    const auto parts = [&](std::vector<bool> holds) {
      const auto part = parts_joined_by(graph, holds);
      return *std::max_element(part.begin(), part.end()) + 1;
    };
    CHECK(series.num_cycles == graph.num_edges() - n + 1);
    for (Index k = 0; k < graph.num_edges(); ++k) {
      CHECK((series.label[k] < 0) == is_bridge[k]);
      // Two edges are in series if the graph without both falls apart, and without one does not.
      for (Index l = 0; l < k; ++l) {
        if (is_bridge[k] || is_bridge[l]) continue;
        std::vector<bool> holds(graph.edges().size(), true);
        holds[k] = holds[l] = false;
        CHECK((series.label[k] == series.label[l]) == (parts(holds) == 2));
      }
    }
    // What is left out is as if it were not there.
    std::vector<bool> left_out(graph.edges().size(), false);
    left_out[random.below(graph.num_edges())] = true;
    std::vector<bool> holds(left_out.size());
    for (std::size_t k = 0; k < holds.size(); ++k) holds[k] = !left_out[k];
    const Series rest = series_of(graph, left_out);
    CHECK(rest.num_cycles == graph.num_edges() - 1 - n + parts(holds));
  }
}

TEST_CASE("the part that cycles check is the graph without its bridges, which are met exactly") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 20; ++repeat) {
    const Index n = 3 + random.below(12);
    const MeasurementGraph graph(test::simulate(random, test::random_connected(random, n, 2), 0.3));
    const CheckedPart part(graph, {});
    Rotations R = random.rotations(part.graph().num_nodes());
    const Rotations all = part.extended(R);
    REQUIRE(all.size() == static_cast<std::size_t>(n));
    std::vector<double> x, x_part;
    squared_residuals(graph, to_quaternions(all), 1, x);
    squared_residuals(part.graph(), to_quaternions(R), 1, x_part);
    const std::vector<double> kept = part.of_edges(x);
    REQUIRE(kept.size() == x_part.size());
    for (std::size_t k = 0; k < kept.size(); ++k) {
      CHECK(kept[k] == doctest::Approx(x_part[k]).epsilon(1e-9).scale(1.0));
    }
    for (Index k = 0; k < graph.num_edges(); ++k) {
      if (part.is_bridge(k)) CHECK(x[k] < 1e-20);
    }
  }
}

TEST_CASE("what is left out is no part of what cycles check, and joins what nothing else does") {
  Random random;
  INFO(random.replay());
  // Three complete graphs, which only edges join that are left out; so is one within the first.
  test::Pairs pairs;
  for (const Index first : {0, 5, 10}) {
    for (const auto& [i, j] : test::complete(5)) pairs.emplace_back(first + i, first + j);
  }
  const std::size_t within = 3, kept = pairs.size();
  for (Index k = 0; k < 4; ++k) pairs.emplace_back(10 + k, 5 + k);
  for (Index k = 0; k < 3; ++k) pairs.emplace_back(5 + k, k);
  const Rotations truth = random.rotations(15);
  const MeasurementGraph graph(test::measure(random, pairs, truth, 0.0));
  std::vector<bool> left_out(pairs.size(), false);
  left_out[within] = true;
  for (std::size_t k = kept; k < pairs.size(); ++k) left_out[k] = true;
  const CheckedPart part(graph, left_out);
  CHECK(part.graph().num_edges() == 29);
  CHECK(part.graph().num_nodes() == 15);
  Rotations R = truth;
  for (const Index first : {0, 5, 10}) {
    const Matrix3 gauge = random.rotation();
    for (Index i = first; i < first + 5; ++i) R[i] = gauge * R[i];
  }
  std::vector<double> x;
  squared_residuals(graph, to_quaternions(part.extended(R)), 1, x);
  for (const double x_k : x) CHECK(x_k < 1e-20);
  // Where all are left out, nothing is.
  const CheckedPart all(graph, std::vector<bool>(pairs.size(), true));
  CHECK(all.graph().num_edges() == graph.num_edges());
  CHECK(all.extended(truth) == truth);
}

TEST_CASE("a chain of bridges changes nothing of what it hangs on, with any loss") {
  Random random;
  INFO(random.replay());
  const auto core = test::simulate(random, test::complete(5), 0.03);
  auto chain = core;
  for (Index i = 4; i < 9; ++i) chain.push_back({i, i + 1, random.rotation(), 1.0});
  const MeasurementGraph with(chain), without(core);
  for (const Loss kind : all_losses) {
    CAPTURE(static_cast<int>(kind));
    RobustOptions robust;
    robust.loss = kind;
    const RobustSolution a = solve_robust(without, {}, robust), b = solve_robust(with, {}, robust);
    CHECK(a.noise == b.noise);
    CHECK(a.loss.scale == b.loss.scale);
    for (std::size_t k = 0; k < chain.size(); ++k) {
      const EdgeVerdict expected = k < core.size() ? a.verdicts.edges[k] : EdgeVerdict::bridge;
      CHECK(b.verdicts.edges[k] == expected);
    }
    CHECK(b.certificate.verdict == Verdict::proved);
  }
}

TEST_CASE("of a ring, what it leaves over is one datum, however it is shared") {
  std::vector<RelativeRotation> ring;
  for (Index i = 0; i < 9; ++i) ring.push_back({i, (i + 1) % 9, exp_so3({0, 0, 0.7155}), 1.0});
  const MeasurementGraph graph(ring);
  const double left = std::abs(9 * 0.7155 - 2.0 * 3.141592653589793);
  const Series series = series_of(graph);
  CHECK(series.size == 1);
  CHECK(series.freedom() == 1.0);
  std::vector<double> even(9, left * left / 81.0), one(9, 0.0);
  one[4] = left * left;
  CHECK(series_residuals(series, even, {})[0] == doctest::Approx(left * left / 9.0));
  CHECK(series_residuals(series, one, {})[0] == doctest::Approx(left * left / 9.0));
  for (const Loss kind : all_losses) {
    RobustOptions robust;
    robust.loss = kind;
    const RobustSolution solution = solve_robust(graph, {}, robust);
    CHECK(solution.noise == doctest::Approx(left / 3.0 / 0.6724).epsilon(0.02));
    for (const EdgeVerdict verdict : solution.verdicts.edges) CHECK(!is_outlier(verdict));
  }
}

TEST_CASE("a wrong edge in a chain between junctions is found, and one edge of the chain named") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::complete(12);
  const auto first = static_cast<std::size_t>(pairs.size());
  for (Index i = 0; i < 4; ++i) pairs.emplace_back(i == 0 ? 0 : 11 + i, i == 3 ? 5 : 12 + i);
  auto measurements = test::measure(random, pairs, random.rotations(15), 0.01);
  measurements[first + 2].i_from_j *= exp_so3(0.5 * random.direction());
  const RobustSolution solution = solve_robust(MeasurementGraph(measurements));
  Index named = 0;
  for (std::size_t k = first; k < pairs.size(); ++k) {
    named += is_outlier(solution.verdicts.edges[k]);
  }
  CHECK(named >= 1);
  CHECK(named < 4);
}

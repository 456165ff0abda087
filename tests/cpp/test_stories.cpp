#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/common_ancestors.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/robust/evidence.hpp>
#include <rotavg/robust/neighbourhoods.hpp>
#include <rotavg/robust/part_votes.hpp>
#include <rotavg/robust/relative_weights.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/stories.hpp>
#include <rotavg/robust/strongest.hpp>

#include "support/folded_ring.hpp"
#include "support/graphs.hpp"
#include "support/largest_error.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::largest_error;
using rotavg::test::Random;

TEST_CASE("the maximum spanning tree has the largest weight of all trees") {
  Random random;
  INFO(random.replay());
  for (int run = 0; run < 20; ++run) {
    const auto pairs = test::random_connected(random, 7, 5);
    auto measurements = test::simulate(random, pairs, 0.3);
    for (RelativeRotation& m : measurements) m.weight = random.uniform(1.0, 2.0);
    const MeasurementGraph graph(measurements);
    const Rotations R = maximum_spanning_tree_init(graph);
    double weight = 0.0;  // of the edges that the tree meets exactly
    Index met = 0;
    for (const Edge& e : graph.edges()) {
      if ((R[e.i] * e.i_from_j() - R[e.j]).norm() > 1e-9) continue;
      weight += e.weight;
      ++met;
    }
    CHECK(met == graph.num_nodes() - 1);
    double most = 0.0;  // by trying all sets of n - 1 edges
    const Index n = graph.num_nodes(), m = graph.num_edges();
    for (unsigned set = 0; set < (1u << m); ++set) {
      std::vector<bool> holds(m);
      double sum = 0.0;
      Index count = 0;
      for (Index k = 0; k < m; ++k) {
        holds[k] = ((set >> k) & 1u) != 0;
        count += holds[k];
        sum += holds[k] ? graph.edges()[k].weight : 0.0;
      }
      if (count != n - 1 || sum <= most) continue;
      const auto part = parts_joined_by(graph, holds);
      if (*std::max_element(part.begin(), part.end()) == 0) most = sum;
    }
    CHECK(weight == doctest::Approx(most));
  }
}

TEST_CASE("overlap is the weighted Jaccard index over triangles that agree") {
  Random random;
  INFO(random.replay());
  const Index n = 12;
  auto measurements = test::simulate(random, test::complete(n), 1e-3);
  for (RelativeRotation& m : measurements) m.weight = random.uniform(0.5, 3.0);
  measurements[5].i_from_j = random.rotation();
  const MeasurementGraph graph(measurements);
  const std::vector<double> weights = graph.weights();
  const std::vector<double> overlap = Neighbourhoods(graph).overlap(weights);
  std::vector<RelativeRotation> twice = measurements;  // of parallel edges one makes a triangle
  twice.insert(twice.end(), measurements.begin(), measurements.end());
  const MeasurementGraph doubled(twice);
  const std::vector<double> of_both = Neighbourhoods(doubled).overlap(doubled.weights());
  std::vector<double> w(n * n, 0.0);
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge& e = graph.edges()[k];
    w[e.i * n + e.j] = w[e.j * n + e.i] = weights[k];
  }
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const Edge& e = graph.edges()[k];
    double shared = 0.0, either = 0.0;
    for (Index q = 0; q < n; ++q) {
      const auto touches = [&](Index a, Index b) {
        const Edge& wrong = graph.edges()[5];
        return (wrong.i == a && wrong.j == b) || (wrong.i == b && wrong.j == a);
      };
      const bool agrees = k != 5 && !touches(e.i, q) && !touches(e.j, q);
      if (q != e.i && q != e.j && agrees) shared += std::min(w[e.i * n + q], w[e.j * n + q]);
      either += w[e.i * n + q] + w[e.j * n + q];
    }
    const double own = 1e-3 * weights[k];
    CHECK(overlap[k] == doctest::Approx((shared + own) / (either - shared + own)));
    for (const Index copy : {k, k + graph.num_edges()}) {
      CHECK(of_both[copy] == doctest::Approx((shared + own) / (2.0 * either - shared + own)));
    }
  }
}

TEST_CASE("every node has eight voices, or as many as edges") {
  Random random;
  INFO(random.replay());
  const auto graph = test::simulate_graph(random, test::random_connected(random, 90, 1500), 0.1);
  REQUIRE(num_strongest(graph.num_nodes(), graph.num_edges()) == 8);
  std::vector<double> strength;
  for (Index k = 0; k < graph.num_edges(); ++k) strength.push_back(random.uniform(0.0, 1.0));
  const Evidence evidence(graph, strength, {});
  double expected = 0.0;
  for (Index l = 0; l < graph.num_nodes(); ++l) expected += std::min<Index>(8, graph.row(l).size());
  CHECK(std::accumulate(evidence.voices().begin(), evidence.voices().end(), 0.0) == expected);
  // An answer that explains all against one that explains nothing.
  const std::vector<double> zero(strength.size(), 0.0), much(strength.size(), 1e3);
  const auto comparison = evidence.compare(zero, much);
  CHECK(comparison.voices == expected);
  CHECK(comparison.edges() == graph.num_edges());
  CHECK(comparison.other_edges() == 0);
  CHECK(comparison.clear());
  CHECK_FALSE(evidence.compare(much, zero).clear());
}

TEST_CASE("a handful of edges does not win by what voices it was fitted to") {
  Comparison c;
  for (const Index edges : {7, 14}) {
    c.only_first.assign(static_cast<std::size_t>(edges), 0);
    c.only_other.assign(static_cast<std::size_t>(3 * edges), 0);
    c.voices = 1.4 * edges;
    c.other_voices = 0.4 * edges;
    CHECK(c.lead_in_voices() > 1.5);
    CHECK(c.lead_in_voices() < 3.0);
    CHECK(c.lead_in_strength() > 3.0);
    CHECK(c.clear() == (edges == 14));
  }
}

TEST_CASE("relative weights are those over the median of edges that turn as far") {
  Random random;
  INFO(random.replay());
  for (const Index n : {3, 8, 40}) {
    auto measurements = test::simulate(random, test::complete(n), 0.1);
    for (RelativeRotation& m : measurements) m.weight = std::exp(random.normal());
    const MeasurementGraph graph(measurements);
    const std::vector<double> weights = graph.weights();
    const std::vector<double> relative = relative_weights(graph, weights);
    const std::size_t m = weights.size(), bins = std::clamp<std::size_t>(m / 10, 1, 20);
    std::vector<std::size_t> order(m);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return graph.edges()[a].i_from_j().trace() > graph.edges()[b].i_from_j().trace();
    });
    for (std::size_t b = 0; b < bins; ++b) {
      std::vector<double> of_bin;
      const std::size_t first = m * b / bins, last = m * (b + 1) / bins;
      for (std::size_t k = first; k < last; ++k) of_bin.push_back(weights[order[k]]);
      std::sort(of_bin.begin(), of_bin.end());
      const double median = of_bin[of_bin.size() / 2];
      for (std::size_t k = first; k < last; ++k) {
        CHECK(relative[order[k]] == doctest::Approx(weights[order[k]] / median));
      }
    }
  }
}

TEST_CASE("of two answers that explain as much, that of the greater relative weights is told") {
  Random random;
  INFO(random.replay());
  const auto graph = test::simulate_graph(random, test::complete(20), 0.1);
  const std::size_t m = graph.edges().size();
  std::vector<double> x(m, 1.0), other(m, 1.0), relative;
  for (std::size_t k = 0; k < m; ++k) {
    (k % 2 == 0 ? x : other)[k] = 100.0;
    relative.push_back(std::exp((k % 2 == 0 ? 0.0 : 1.0) + random.normal()));
  }
  const Evidence evidence(graph, std::vector<double>(m, 1.0), relative);
  const auto comparison = evidence.compare(x, other);
  // The difference of two means, 1, in units of sqrt(1 / 95 + 1 / 95).
  CHECK(comparison.lead_in_weight() == doctest::Approx(6.9).epsilon(0.5));
  CHECK(comparison.lead() == comparison.lead_in_weight());
  CHECK(comparison.clear());
  CHECK(evidence.compare(other, x).lead_in_weight() ==
        doctest::Approx(-comparison.lead_in_weight()));
  const Evidence even(graph, std::vector<double>(m, 1.0), {});
  CHECK(even.compare(x, other).lead() == even.compare(x, other).lead_in_voices());
}

TEST_CASE("cameras share their strongest neighbours, whatever an edge says of its own precision") {
  Random random;
  INFO(random.replay());
  const test::Folded ring = test::folded_ring(random, 80, 0.002, 6, 1);
  std::vector<RelativeRotation> measurements = ring.measurements;
  for (RelativeRotation& m : measurements) m.weight = std::exp(random.normal());
  const MeasurementGraph graph(measurements);
  const Neighbourhoods neighbourhoods(graph);
  const std::vector<double> strength =
      shared_strongest(graph, neighbourhoods, neighbourhoods.overlap(graph.weights()));
  const std::vector<double> ends = strongest(graph, strength);
  double folding = 0.0, all = 0.0;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    CHECK(strength[k] >= 0.0);
    const Edge& e = graph.edges()[k];
    const bool folds = (ring.truth[e.i] * e.i_from_j() - ring.truth[e.j]).norm() > 0.1;
    if (folds) folding += ends[k];
    all += ends[k];
  }
  CHECK(all == graph.num_nodes() * num_strongest(graph.num_nodes(), graph.num_edges()));
  CHECK(folding < 0.02 * all);  // 120 of 600 edges fold
  const std::vector<Index> part = parts_joined_by(graph, skeleton(graph, ends));
  CHECK(*std::max_element(part.begin(), part.end()) == 0);
}

TEST_CASE("the skeleton joins what the graph joins") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::complete(12);
  for (const auto& [i, j] : test::complete(12)) pairs.emplace_back(i + 12, j + 12);
  pairs.emplace_back(0, 12);  // none of the strongest
  const auto graph = test::simulate_graph(random, pairs, 0.0);
  std::vector<double> strength(pairs.size(), 1.0);
  strength.back() = 0.0;
  const std::vector<double> ends = strongest(graph, strength);
  CHECK(ends.back() == 0.0);
  CHECK(skeleton(graph, ends).back());
}

TEST_CASE("groups are told apart by a step, in every component by itself") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::complete(8);  // and another component
  for (const auto& [i, j] : test::complete(6)) pairs.emplace_back(i + 8, j + 8);
  const auto graph = test::simulate_graph(random, pairs, 0.0);
  const Rotations R = random.rotations(14);
  const Matrix3 gauge = random.rotation(), other_gauge = random.rotation();
  const Matrix3 step = exp_so3(Vector3(0.0, 0.5, 0.0));
  Rotations S;
  for (Index i = 0; i < 14; ++i) {
    S.push_back((i < 8 ? gauge : other_gauge) * R[i]);
    if (i >= 5 && i < 8) S.back() = gauge * step * R[i];
  }
  const std::vector<Index> group = shared_groups(graph, R, S, 0.1);
  CHECK(group == std::vector<Index>{0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0});
  adopt_gauge(connected_components(graph).label, group, R, S);
  for (Index i = 0; i < 14; ++i) CHECK((group[i] == 0) == ((R[i] - S[i]).norm() < 1e-9));
}

TEST_CASE("the lowest common ancestor in a forest is where the ways to the roots meet") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 20; ++repeat) {
    const Index n = 1 + random.below(60), back = 1 + random.below(8);
    std::vector<Index> parent(n, -1), order(n);
    std::iota(order.begin(), order.end(), 0);
    for (Index v = 1; v < n; ++v) {
      if (random.below(12) > 0) parent[v] = v - 1 - random.below(std::min(v, back));
    }
    const CommonAncestors common(parent, order);
    for (Index a = 0; a < n; ++a) {
      std::vector<Index> above{a};
      while (parent[above.back()] >= 0) above.push_back(parent[above.back()]);
      CHECK(common.depth(a) == static_cast<Index>(above.size()) - 1);
      for (Index b = 0; b < n; ++b) {
        Index at = b;
        while (at >= 0 && std::find(above.begin(), above.end(), at) == above.end()) {
          at = parent[at];
        }
        CHECK(common(a, b) == at);
      }
    }
  }
}

TEST_CASE("wrong closures on a long chain of poses have no more voices than memory holds") {
  Random random;
  INFO(random.replay());
  constexpr Index poses = 20000, wrong = 1000;  // 6.7e6 cuts are crossed
  test::Pairs pairs = test::path(poses);
  auto measurements = test::simulate(random, pairs, 0.0);
  for (Index k = 0; k < wrong; ++k) {
    measurements.push_back(
        {random.below(poses / 2), poses / 2 + random.below(poses / 2), random.rotation(), 1.0});
  }
  const MeasurementGraph graph(measurements);
  const Rotations R = maximum_spanning_tree_init(MeasurementGraph(
      std::vector<RelativeRotation>(measurements.begin(), measurements.begin() + poses - 1)));
  std::vector<double> x;
  squared_residuals(graph, to_quaternions(R), 1, x);
  const detail::Sides sides = detail::sides_of(graph, {}, x, 0.01, R);
  std::size_t voices = 0, silent = 0;
  for (const auto& cast : sides.ballots) {
    voices += cast.size();
    silent += cast.empty();
  }
  CHECK(voices < 1200000);
  CHECK(voices > 700000);
  CHECK(silent < poses / 50);  // near the ends, and the root
}

TEST_CASE("two edges that agree turn what one of great weight holds") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::complete(6);
  for (const auto& [i, j] : test::complete(6)) pairs.emplace_back(i + 6, j + 6);
  const Rotations truth = random.rotations(13);
  const auto measurement = [&](Index i, Index j, const Matrix3& error) {
    RelativeRotation m;
    m.i = i;
    m.j = j;
    m.i_from_j = truth[i].transpose() * truth[j] * error;
    return m;
  };
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : pairs) measurements.push_back(measurement(i, j, Matrix3::Identity()));
  const Matrix3 wrong = exp_so3(Vector3(1.5, 0.0, 0.0));
  measurements.push_back(measurement(0, 6, wrong));
  measurements.push_back(measurement(1, 7, exp_so3(Vector3(0.0, 1e-3, 0.0))));
  measurements.push_back(measurement(2, 8, exp_so3(Vector3(0.0, 0.0, 1e-3))));
  measurements.push_back(measurement(12, 11, Matrix3::Identity()));  // hangs on the other side
  const MeasurementGraph graph(measurements);
  Rotations R = truth;  // as the wrong edge has it
  const Matrix3 turn = truth[0] * measurements[30].i_from_j * truth[6].transpose();
  for (Index i = 6; i < 13; ++i) R[i] = turn * R[i];
  std::vector<double> x;
  squared_residuals(graph, to_quaternions(R), 1, x);
  CHECK(take_part_votes(graph, {}, x, 0.01, R) == 1);
  CHECK(largest_error(R, truth) < 0.01);
  squared_residuals(graph, to_quaternions(R), 1, x);
  CHECK(take_part_votes(graph, {}, x, 0.01, R) == 0);
}

TEST_CASE("the other place of what a single edge holds is that of the edges it contradicts") {
  Random random;
  INFO(random.replay());
  // Complete graphs of six, seven and two nodes. One edge holds the seven on the six, and two that
  // agree with one another contradict it, as does a third; one edge alone holds the two.
  Rotations truth;
  for (Index i = 0; i < 15; ++i) truth.push_back(random.rotation());
  std::vector<RelativeRotation> measurements;
  const auto add = [&](Index i, Index j, const Matrix3& turn) {
    RelativeRotation m;
    m.i = i;
    m.j = j;
    m.i_from_j = truth[i].transpose() * turn * truth[j];
    measurements.push_back(m);
  };
  const auto group = [](Index i) { return i < 6 ? 0 : i < 13 ? 1 : 2; };
  for (Index i = 0; i < 15; ++i) {
    for (Index j = i + 1; j < 15; ++j) {
      if (group(i) == group(j)) add(i, j, Matrix3::Identity());
    }
  }
  const Matrix3 turn = exp_so3(Vector3(0.3, -1.0, 2.0)), other = exp_so3(Vector3(0.0, 0.9, 0.0));
  add(0, 6, Matrix3::Identity());
  add(1, 7, other);
  add(2, 8, turn);
  add(3, 9, turn);
  add(4, 13, Matrix3::Identity());
  const MeasurementGraph graph(measurements);
  std::vector<double> x;
  squared_residuals(graph, to_quaternions(truth), 1, x);
  Rotations expected = truth;
  for (Index i = 6; i < 13; ++i) expected[i] = turn * truth[i];
  const std::vector<Rotations> told = other_places(graph, {}, x, 0.01, truth, 3.0, 4);
  REQUIRE(told.size() == 1);
  CHECK(largest_error(told[0], expected) < 1e-6);
  CHECK(other_places(graph, {}, x, 0.01, truth, 8.0, 4).empty());  // the side is smaller
  CHECK(other_places(graph, {}, x, 0.01, truth, 3.0, 0).empty());
}

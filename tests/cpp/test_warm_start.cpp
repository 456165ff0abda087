#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/components.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/init/warm_start.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/contaminated.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Labels from 0 to num_pieces - 1, and -1, at random.
std::vector<Index> random_pieces(Random& random, Index n, Index num_pieces) {
  std::vector<Index> piece;
  for (Index i = 0; i < n; ++i) piece.push_back(random.below(num_pieces + 1) - 1);
  return piece;
}

/// Every piece turned by a rotation of its own; what is in none is nonsense.
Rotations turned_pieces(Random& random, const Rotations& truth, const std::vector<Index>& piece) {
  const Rotations turn = random.rotations(static_cast<Index>(truth.size()));
  Rotations R(truth.size(), Matrix3::Constant(std::nan("")));
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (piece[i] >= 0) R[i] = turn[piece[i]] * truth[i];
  }
  return R;
}

}  // namespace

TEST_CASE("pieces are put together exactly where there is no noise") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const Rotations truth = random.rotations(40);
    auto measurements = test::measure(random, test::random_connected(random, 30, 20), truth, 0.0);
    for (Index i = 30; i + 2 < 40; ++i) {  // another component, and a node that stands alone
      measurements.push_back({i, i + 1, truth[i].transpose() * truth[i + 1]});
    }
    test::spread_weights(random, 3.0, measurements);
    std::vector<NodeId> nodes;
    for (NodeId i = 0; i < 40; ++i) nodes.push_back(i);
    const MeasurementGraph graph(measurements, nodes);
    const auto piece = random_pieces(random, 40, 1 + random.below(10));
    const Rotations R = join_pieces(graph, turned_pieces(random, truth, piece), piece);
    CHECK(objective(graph, R) < 1e-20 * graph.total_weight());
  }
}

TEST_CASE("with noise pieces stay as they are, the largest is held, and a tree of edges is met") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    constexpr Index n = 30, num_pieces = 6;
    const MeasurementGraph graph =
        test::simulate_graph(random, test::random_connected(random, n, 40), 0.5);
    const auto piece = random_pieces(random, n, num_pieces);
    const Rotations given = turned_pieces(random, random.rotations(n), piece);
    const Rotations R = join_pieces(graph, given, piece);

    std::vector<Index> size(num_pieces, 0);
    for (const Index label : piece) {
      if (label >= 0) ++size[label];
    }
    const auto largest =
        static_cast<Index>(std::max_element(size.begin(), size.end()) - size.begin());
    for (Index i = 0; i < n; ++i) {
      if (piece[i] == largest && size[largest] > 1) CHECK((R[i] - given[i]).norm() < 1e-14);
      for (Index j = 0; j < i; ++j) {
        if (piece[i] < 0 || piece[i] != piece[j]) continue;
        const Matrix3 before = given[i].transpose() * given[j];
        REQUIRE((R[i].transpose() * R[j] - before).norm() < 1e-13);
      }
    }
    // The edges that are met exactly join all pieces.
    std::vector<Index> joined(piece);
    for (Index i = 0; i < n; ++i) {
      if (joined[i] < 0) joined[i] = num_pieces + i;
    }
    for (const Edge& e : graph.edges()) {
      if (residual(e, R).norm() > 1e-13) continue;
      const Index from = joined[e.i], to = joined[e.j];
      std::replace(joined.begin(), joined.end(), from, to);
    }
    REQUIRE(std::set<Index>(joined.begin(), joined.end()).size() == 1);
  }
}

TEST_CASE("of several edges between two pieces, those decide that agree, not the heaviest") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(20);
  test::Pairs pairs;
  for (Index i = 0; i < 10; ++i) pairs.emplace_back(i, i + 10);
  auto measurements = test::measure(random, pairs, truth, 0.01);
  for (int k = 0; k < 3; ++k) {
    measurements[k].i_from_j = random.rotation();
    measurements[k].weight = 2.0;
  }
  const MeasurementGraph graph(measurements);
  std::vector<Index> piece(20, 3);
  for (Index i = 10; i < 20; ++i) piece[i] = 7;
  const Rotations R = join_pieces(graph, turned_pieces(random, truth, piece), piece);
  const Matrix3 expected = truth[0].transpose() * truth[10];
  CHECK(angle_between(R[0].transpose() * R[10], expected) < 0.05);
}

TEST_CASE("what was found for another graph is matched by the ids of the nodes") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(12);
  const auto measured = [&](const test::Pairs& pairs) {
    auto measurements = test::measure(random, pairs, truth, 0.0);
    for (RelativeRotation& m : measurements) m.i = 100 - m.i, m.j = 100 - m.j;
    return measurements;
  };
  // Two components that lack nodes 5 and 11, and have the nodes 10 and 4 that are dropped.
  const MeasurementGraph other(
      measured({{0, 1}, {1, 2}, {2, 4}, {4, 3}, {6, 7}, {7, 8}, {8, 10}, {10, 9}}));
  const Components components = connected_components(other);
  REQUIRE(components.size() == 2);
  const MeasurementGraph graph(measured({{0, 1}, {1, 2}, {3, 6}, {6, 7}, {5, 8}, {11, 5}, {9, 0}}),
                               {100, 99, 98, 97, 95, 94, 93, 92, 91, 89});
  REQUIRE(connected_components(graph).size() == 3);
  const Rotations R = warm_start(graph, other, shortest_path_init(other), components);
  CHECK(objective(graph, R) < 1e-20);
  // Nodes 0 and 3 are joined in the other graph alone.
  CHECK((R[0].transpose() * R[3] - truth[0].transpose() * truth[3]).norm() < 1e-14);

  const MeasurementGraph stranger(std::vector<RelativeRotation>{{1, 2, Matrix3::Identity()}});
  CHECK_THROWS_WITH_AS(warm_start(stranger, other, shortest_path_init(other), components),
                       "the two graphs have no node in common", std::invalid_argument);
  CHECK_THROWS_AS(warm_start(graph, other, Rotations(3), components), std::invalid_argument);
}

TEST_CASE("nothing changes where nothing has changed") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::grid(10, 20), 0.1);
  const MeasurementGraph graph(measurements);
  const Solution cold = solve(graph);
  const Rotations start = warm_start(graph, graph, cold.rotations, cold.components);
  CHECK(start == cold.rotations);
  const Solution again = solve(graph, {}, start);
  CHECK(again.iterations == 0);
  CHECK(again.certificate.verdict == Verdict::proved);
}

TEST_CASE("after a few new edges a sparse graph is solved by Newton's method at once") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(400);
  const test::Pairs grid = test::grid(20, 20);
  auto measurements = test::measure(random, grid, truth, 0.1);
  const MeasurementGraph before(measurements);
  const Solution last = solve(before);
  for (const RelativeRotation& m :
       test::measure(random, {{0, 200}, {7, 333}, {50, 399}}, truth, 0.1)) {
    measurements.push_back(m);
  }
  const MeasurementGraph graph(measurements);
  SolveOptions from_tree;  // coarser graphs would be as near
  from_tree.init = Initialization::shortest_path;
  const Solution cold = solve(graph, from_tree);
  const Solution warm =
      solve(graph, {}, warm_start(graph, before, last.rotations, last.components));
  CHECK(warm.iterations < cold.iterations - 1);
  CHECK(warm.reason.find("from a start that is near") != std::string::npos);
  CHECK(warm.method == Method::newton);
  CHECK(warm.certificate.verdict == Verdict::proved);
  CHECK(warm.objective == doctest::Approx(cold.objective).epsilon(1e-9));
}

TEST_CASE("a robust solution goes on from its own answer without l1 and graduation, and stays") {
  Random random;
  INFO(random.replay());
  const auto [graph, truth, is_wrong] = test::contaminated(random, test::complete(40), 0.03, 0.4);
  for (const Loss kind : {Loss::cauchy, Loss::geman_mcclure, Loss::tls}) {
    CAPTURE(static_cast<int>(kind));
    RobustOptions robust;
    robust.loss = kind;
    robust.scale = 0.15;
    const RobustSolution first = solve_robust(graph, {}, robust);
    robust.continues = true;
    CHECK(solve_robust(graph, {}, robust).objective == first.objective);  // there is no start
    const RobustSolution again = solve_robust(graph, {}, robust, first.rotations);
    CHECK(again.reason.find("after 0 of l1") != std::string::npos);
    CHECK(again.robust_objective <= first.robust_objective * (1.0 + 1e-9));
    CHECK(again.robust_objective == doctest::Approx(first.robust_objective).epsilon(1e-4));
    CHECK(again.iterations < first.iterations);
    CHECK(again.certificate.verdict == Verdict::proved);
  }
}

TEST_CASE("join_pieces refuses what does not fit the graph") {
  const MeasurementGraph graph = test::noiseless_cycle(3);
  const Rotations R(3, Matrix3::Identity());
  CHECK_THROWS_AS(join_pieces(graph, R, {0, 0}), std::invalid_argument);
  CHECK_THROWS_AS(join_pieces(graph, Rotations(2), {0, 0, 0}), std::invalid_argument);
  CHECK_THROWS_AS(join_pieces(graph, R, {0, 3, 0}), std::invalid_argument);
  CHECK_THROWS_AS(join_pieces(graph, R, {0, -2, 0}), std::invalid_argument);
  CHECK_THROWS_AS(join_pieces(graph, {R[0], 2.0 * R[0], R[0]}, {0, 0, 0}), InvalidRotation);
}

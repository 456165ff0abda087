#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/coarsening.hpp>
#include <rotavg/init/multilevel.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

double start_objective(const MeasurementGraph& graph) {
  const auto R = multilevel_init(graph);
  REQUIRE(R.has_value());
  return objective(graph, *R);
}

}  // namespace

TEST_CASE("a node is matched along its heaviest edge, and what rides together fits exactly") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const auto edges = test::simulate(random, test::random_connected(random, 30, 40), 0.5);
    const MeasurementGraph graph(edges);
    const NodeGroups groups = heavy_edge_matching(graph);
    std::vector<Index> size(static_cast<std::size_t>(groups.count), 0);
    for (const Index g : groups.group) ++size[static_cast<std::size_t>(g)];
    for (const Index s : size) CHECK(s >= 2);
    // Every group rides on the edges of a tree, which cost nothing.
    const Quaternions q = groups.nodes_from(
        Quaternions(static_cast<std::size_t>(groups.count), Quaternion::Identity()));
    const Rotations R = to_rotations(q);
    int met = 0;
    for (const Edge& e : graph.edges()) {
      const auto i = static_cast<std::size_t>(e.i), j = static_cast<std::size_t>(e.j);
      if (groups.group[i] == groups.group[j]) met += residual(e, R).norm() < 1e-14 ? 1 : 0;
    }
    CHECK(met >= graph.num_nodes() - groups.count);
  }
}

TEST_CASE("nodes without edges make no groups") {
  std::vector<RelativeRotation> edge(1);
  edge[0].i = 3;
  edge[0].j = 5;
  const MeasurementGraph graph(edge, {1, 3, 4, 5, 6});
  const NodeGroups groups = heavy_edge_matching(graph);
  CHECK(groups.count == 1);
  CHECK(groups.group == std::vector<Index>(5, 0));
  const HalfEdgeRows rows = coarse_rows(graph, groups);
  CHECK(rows.num_nodes() == 1);
  CHECK(rows.num_edges() == 0);
  CHECK(heavy_edge_matching(rows).count == 0);
}

TEST_CASE("the heaviest edge of a path is the first to go") {
  std::vector<RelativeRotation> path(3);
  const double weights[] = {1.0, 10.0, 1.0};
  for (int k = 0; k < 3; ++k) {
    path[static_cast<std::size_t>(k)].i = k;
    path[static_cast<std::size_t>(k)].j = k + 1;
    path[static_cast<std::size_t>(k)].weight = weights[k];
  }
  // Node 0 comes first and has but one edge; then 1 is taken, and 2 finds 3.
  CHECK(heavy_edge_matching(MeasurementGraph(path)).group == std::vector<Index>{0, 0, 1, 1});
  std::swap(path[0].i, path[0].j);
  std::swap(path[0], path[1]);
  const MeasurementGraph from_the_middle(path, {1, 0, 2, 3});
  // Rows: 1, 0, 2, 3. Node 1 takes 2; 0 and 3 join them.
  CHECK(heavy_edge_matching(from_the_middle).group == std::vector<Index>{0, 0, 0, 0});
}

TEST_CASE("edges between two groups become one, their mean, and weigh less where they contradict") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    // Two pairs of nodes, each joined by a heavy edge, and two edges between them, which are off by
    // an angle in opposite directions.
    const double angle = random.uniform(0.0, 1.5);
    const Matrix3 off = exp_so3(Vector3(0.0, 0.0, angle));
    test::Pairs pairs{{0, 1}, {2, 3}, {0, 2}, {1, 3}};
    auto edges = test::simulate(random, pairs, 0.0);
    edges[0].weight = edges[1].weight = 100.0;
    edges[2].weight = edges[3].weight = 2.0;
    // Groups see both between the frames of nodes 0 and 2.
    edges[2].i_from_j = off * edges[2].i_from_j;
    edges[3].i_from_j =
        edges[0].i_from_j.transpose() * off.transpose() * edges[0].i_from_j * edges[3].i_from_j;
    const MeasurementGraph graph(edges);
    const NodeGroups groups = heavy_edge_matching(graph);
    REQUIRE(groups.group == std::vector<Index>{0, 0, 1, 1});
    const HalfEdgeRows coarse = coarse_rows(graph, groups);
    REQUIRE(coarse.num_nodes() == 2);
    for (Index a = 0; a < 2; ++a) {
      REQUIRE(coarse.row(a).size() == 1);
      const HalfEdge h = *coarse.row(a).begin();
      CHECK(h.node == 1 - a);
      // Two unit quaternions angle / 2 off their mean to either side.
      CHECK(h.node_from_l.squaredNorm() == doctest::Approx(4.0 * std::cos(0.5 * angle)));
    }
    // Both at `angle` from their mean, and then sweeps.
    const double at_mean = 2.0 * 2.0 * 8.0 * std::pow(std::sin(0.5 * angle), 2);
    CHECK(start_objective(graph) <= at_mean * (1.0 + 1e-9));
  }
}

TEST_CASE("the multilevel start is exact without noise, in every component") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    auto edges = test::simulate(random, test::random_connected(random, 60, 10), 0.0);
    for (RelativeRotation m : test::simulate(random, test::grid(4, 5), 0.0)) {
      m.i += 100;
      m.j += 100;
      edges.push_back(m);
      if (random.uniform(0.0, 1.0) < 0.3) edges.push_back(m);  // a parallel one
    }
    test::spread_weights(random, 3.0, edges);
    std::vector<NodeId> nodes;
    for (NodeId i = 0; i < 130; ++i) nodes.push_back(i);  // some without edges
    const MeasurementGraph graph(edges, nodes);
    CHECK(start_objective(graph) <= 1e-20 * graph.total_weight());
  }
}

TEST_CASE("stars and long chains are exact, too") {
  Random random;
  INFO(random.replay());
  test::Pairs star;
  for (Index j = 1; j < 5000; ++j) star.emplace_back(0, j);
  const MeasurementGraph hub = test::simulate_graph(random, star, 0.3);
  CHECK(start_objective(hub) <= 1e-20 * hub.total_weight());
  const MeasurementGraph chain = test::simulate_graph(random, test::path(100'000), 0.3);
  CHECK(start_objective(chain) <= 1e-20 * chain.total_weight());
}

TEST_CASE("where paths are long, the multilevel start comes near the optimum at any noise") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.01, 0.1, 0.3, 0.5}) {
    for (const auto& pairs : {test::grid(40, 40), test::cycle(2000), test::grid(3, 500)}) {
      auto edges = test::simulate(random, pairs, noise);
      if (random.uniform(0.0, 1.0) < 0.5) test::spread_weights(random, 2.0, edges);
      const MeasurementGraph graph(edges);
      const double start = start_objective(graph);
      SolveOptions options;
      options.certify = false;
      const Solution best = solve(graph, options);
      CHECK(best.init != Initialization::shortest_path);  // it may be the chordal in the end
      CHECK(start >= best.objective * (1.0 - 1e-9));
      // (One cycle has next to no residual, and sweeps do not spread it.)
      if (graph.num_edges() == graph.num_nodes()) continue;
      CHECK(start <= 3.0 * best.objective);
      if (noise >= 0.1) CHECK(start < 0.5 * objective(graph, shortest_path_init(graph)));
    }
  }
}

TEST_CASE(
    "where it is stopped, or coarser graphs have as many edges, there is no multilevel start") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph grid = test::simulate_graph(random, test::grid(20, 20), 0.1);
  for (const int last : {1, 2, 5, 20}) {
    int asked = 0;
    CHECK(!multilevel_init(grid, 1, [&] { return ++asked < last; }).has_value());
    CHECK(asked == last);
  }
  const MeasurementGraph thicket =
      test::simulate_graph(random, test::random_connected(random, 3000, 30'000), 0.1);
  CHECK(!multilevel_init(thicket).has_value());
  SolveOptions options;
  options.init = Initialization::multilevel;
  CHECK(solve(thicket, options).init == Initialization::shortest_path);
  CHECK(solve(grid, options).init == Initialization::multilevel);
}

TEST_CASE(
    "the automatic choice starts from levels only where paths are long and there are cycles") {
  Random random;
  INFO(random.replay());
  const auto chosen = [&](const test::Pairs& pairs, Method method = Method::automatic) {
    SolveOptions options;
    options.method = method;
    options.certify = false;
    options.iteration.max_iterations = 3;
    return solve(test::simulate_graph(random, pairs, 0.1), options).init;
  };
  CHECK(chosen(test::grid(20, 20)) == Initialization::multilevel);
  CHECK(chosen(test::grid(20, 20), Method::newton) == Initialization::multilevel);
  for (const Method paper : {Method::bcd, Method::sum, Method::bcdsr}) {
    CHECK(chosen(test::grid(20, 20), paper) == Initialization::shortest_path);
  }
  CHECK(chosen(test::grid(20, 20), Method::staircase) == Initialization::multilevel);
  test::Pairs cycles;
  for (Index c = 0; c < 50; ++c) {
    for (const auto& [i, j] : test::cycle(40)) cycles.emplace_back(40 * c + i, 40 * c + j);
  }
  CHECK(chosen(cycles) == Initialization::multilevel);
  CHECK(chosen(test::path(400)) == Initialization::shortest_path);
  test::Pairs tail = test::random_connected(random, 2000, 6000);  // with a long tail
  for (Index i = 2000; i < 2060; ++i) tail.emplace_back(i - 1, i);
  CHECK(chosen(tail) == Initialization::shortest_path);
  CHECK(chosen(test::complete(30)) == Initialization::shortest_path);
  CHECK(chosen(test::random_connected(random, 400, 1200)) == Initialization::shortest_path);
}

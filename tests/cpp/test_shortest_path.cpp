#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/objective.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

TEST_CASE("without noise the shortest-path value is optimal: below 1e-20 per edge") {
  Random random;
  INFO(random.replay());
  const std::vector<test::Pairs> graphs = {
      test::complete(2),
      test::complete(50),  // Fig. 5
      test::cycle(3),
      test::cycle(200),    // Fig. 5
      test::cycle(20000),  // errors of a path of 10000 edges meet
      test::path(1000),
      test::grid(30, 40),
      test::random_connected(random, 500, 0),
      test::random_connected(random, 500, 2000),
  };
  for (const test::Pairs& pairs : graphs) {
    auto measurements = test::simulate(random, pairs, 0.0);
    const MeasurementGraph graph(measurements);
    CAPTURE(graph.num_nodes());
    CAPTURE(graph.num_edges());
    CHECK(objective(graph, shortest_path_init(graph)) < 1e-20 * graph.num_edges());

    test::spread_weights(random, 6.0, measurements);
    const MeasurementGraph weighted(measurements);
    CHECK(objective(weighted, shortest_path_init(weighted)) < 1e-20 * weighted.total_weight());
  }
}

TEST_CASE("the shortest-path value recovers the truth up to one rotation per component") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(30);
  auto measurements = test::measure(random, test::random_connected(random, 10, 5), truth, 0.0);
  for (const auto& [i, j] : test::cycle(20)) {
    measurements.push_back({i + 10, j + 10, truth[i + 10].transpose() * truth[j + 10]});
  }
  std::vector<NodeId> nodes;
  for (NodeId id = 0; id < 31; ++id) nodes.push_back(id);  // node 30 stands alone
  const MeasurementGraph graph(measurements, nodes);
  REQUIRE(connected_components(graph).size() == 3);

  const Rotations R = shortest_path_init(graph);
  CHECK(R[0] == Matrix3::Identity());
  CHECK(R[10] == Matrix3::Identity());
  CHECK(R[30] == Matrix3::Identity());
  for (Index i = 0; i < 10; ++i) CHECK((R[i] - truth[0].transpose() * truth[i]).norm() < 1e-14);
  for (Index i = 10; i < 30; ++i) CHECK((R[i] - truth[10].transpose() * truth[i]).norm() < 1e-14);
}

TEST_CASE("with noise every node is measured exactly along a shortest path") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    auto measurements = test::simulate(random, test::random_connected(random, 15, 15), 1.0);
    test::spread_weights(random, 3.0, measurements);
    const MeasurementGraph graph(measurements);
    const std::vector<Index> depth = breadth_first_forest(graph).depth;
    const Rotations R = shortest_path_init(graph);
    std::vector<bool> reached(15, false);
    reached[0] = true;
    for (const Edge& e : graph.edges()) {
      const bool fits = residual(e, R).norm() < 1e-14;
      if (fits && depth[e.j] == depth[e.i] + 1) reached[e.j] = true;
      if (fits && depth[e.i] == depth[e.j] + 1) reached[e.i] = true;
    }
    REQUIRE(reached == std::vector<bool>(15, true));
  }
}

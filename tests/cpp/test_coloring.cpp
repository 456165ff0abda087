#include <algorithm>
#include <set>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/coloring.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/solve/bcd.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

void check_coloring(const MeasurementGraph& graph) {
  const Coloring coloring = greedy_coloring(graph);
  std::vector<Index> color(graph.nodes().size(), -1);
  for (Index c = 0; c < coloring.num_colors(); ++c) {
    REQUIRE(coloring.start[c] < coloring.start[c + 1]);
    for (Index a = coloring.start[c]; a < coloring.start[c + 1]; ++a) {
      REQUIRE(color[coloring.node[a]] == -1);
      color[coloring.node[a]] = c;
    }
  }
  REQUIRE(std::count(color.begin(), color.end(), -1) == 0);
  for (const Edge& e : graph.edges()) REQUIRE(color[e.i] != color[e.j]);
  std::size_t most = 0;  // neighbours
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    std::set<Index> neighbours;
    for (const HalfEdge& h : graph.row(i)) neighbours.insert(h.node);
    most = std::max(most, neighbours.size());
  }
  REQUIRE(coloring.num_colors() <= static_cast<Index>(most) + 1);
}

}  // namespace

TEST_CASE("no edge joins two nodes of one colour, and there are few colours") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const Index n = 2 + random.below(60);
    check_coloring(
        test::simulate_graph(random, test::random_connected(random, n, random.below(4 * n)), 0.1));
  }
  check_coloring(test::simulate_graph(random, test::complete(20), 0.1));
  check_coloring(MeasurementGraph({{0, 1}}, {5, 0, 1, 7}));  // nodes without edges
  CHECK(greedy_coloring(test::simulate_graph(random, test::grid(9, 12), 0.1)).num_colors() == 2);
}

TEST_CASE("sweeps by colours descend to the same optimum, with the same bits on any threads") {
  Random random;
  INFO(random.replay());
  const auto graph = test::simulate_graph(random, test::random_connected(random, 3000, 30000), 0.1);
  const Coloring coloring = greedy_coloring(graph);
  const Rotations R(graph.nodes().size(), Matrix3::Identity());
  IterationOptions options;
  options.num_threads = 1;
  const IterationResult plain = bcd(graph, R, options), one = bcd(graph, R, options, &coloring);
  CHECK(one.status == Status::gradient_converged);
  for (std::size_t k = 1; k < one.trace.size(); ++k) {
    CHECK(one.trace[k].objective <=
          one.trace[k - 1].objective * (1.0 + 1e-12) + 1e-12 * graph.total_weight());
  }
  CHECK(one.objective == doctest::Approx(plain.objective).epsilon(1e-9));
  for (const int num_threads : {2, 3, 8}) {
    options.num_threads = num_threads;
    const IterationResult several = bcd(graph, R, options, &coloring);
    CHECK(several.objective == one.objective);
    CHECK(several.rotations == one.rotations);
    CHECK(several.iterations == one.iterations);
  }
}

// Components, breadth-first forests and the cycles that edges close in them.

#include <algorithm>
#include <cstddef>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/widest_level.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Edges between all pairs of nodes by Floyd's algorithm; n where there is no path.
Eigen::MatrixXi distances(const MeasurementGraph& graph) {
  const Index n = graph.num_nodes();
  Eigen::MatrixXi distance = Eigen::MatrixXi::Constant(n, n, n);
  distance.diagonal().setZero();
  for (const Edge& e : graph.edges()) distance(e.i, e.j) = distance(e.j, e.i) = 1;
  for (Index k = 0; k < n; ++k) {
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        distance(i, j) = std::min(distance(i, j), distance(i, k) + distance(k, j));
      }
    }
  }
  return distance;
}

}  // namespace

TEST_CASE("components are the classes of nodes with a path between them") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const MeasurementGraph graph = test::scattered_graph(random);
    const Index n = graph.num_nodes();
    const Eigen::MatrixXi distance = distances(graph);
    const Components components = connected_components(graph);
    Index nodes_seen = 0;
    for (Index c = 0; c < components.size(); ++c) {
      const auto& nodes = components.nodes[c];
      nodes_seen += static_cast<Index>(nodes.size());
      REQUIRE(std::is_sorted(nodes.begin(), nodes.end()));
      REQUIRE(components.root(c) == nodes.front());
      if (c > 0) REQUIRE(components.root(c - 1) < components.root(c));
      for (std::size_t row = 0; row < nodes.size(); ++row) {
        REQUIRE(components.label[nodes[row]] == c);
        REQUIRE(components.row_in_component[nodes[row]] == static_cast<Index>(row));
      }
    }
    REQUIRE(nodes_seen == n);
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        REQUIRE((components.label[i] == components.label[j]) == (distance(i, j) < n));
      }
    }
  }
}

TEST_CASE("the breadth-first forest has the shortest paths to the first node of each component") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const MeasurementGraph graph = test::scattered_graph(random);
    const Eigen::MatrixXi distance = distances(graph);
    const Components components = connected_components(graph);
    const BreadthFirstForest forest = breadth_first_forest(graph);
    std::vector<bool> seen(static_cast<std::size_t>(graph.num_nodes()), false);
    for (const Index i : forest.order) {
      const Index root = components.root(components.label[i]);
      const Index parent = forest.parent[i];
      REQUIRE(forest.depth[i] == distance(root, i));
      REQUIRE((parent < 0) == (i == root));
      if (parent >= 0) {
        REQUIRE(seen[parent]);
        REQUIRE(forest.depth[i] == forest.depth[parent] + 1);
        const Edge& e = graph.edges()[forest.tree_edge[i]];
        REQUIRE(((e.i == i && e.j == parent) || (e.i == parent && e.j == i)));
      } else {
        REQUIRE(forest.tree_edge[i] == -1);
      }
      REQUIRE(!seen[i]);
      seen[i] = true;
    }
    REQUIRE(forest.order.size() == static_cast<std::size_t>(graph.num_nodes()));
  }
}

TEST_CASE("the widest level of a component has as many nodes as are equally far from its first") {
  Random random;
  INFO(random.replay());
  for (int trial = 0; trial < 20; ++trial) {
    const MeasurementGraph graph = test::scattered_graph(random);
    const Index n = graph.num_nodes();
    const Components components = connected_components(graph);
    const Eigen::MatrixXi distance = distances(graph);
    for (Index c = 0; c < components.size(); ++c) {
      const auto& nodes = components.nodes[static_cast<std::size_t>(c)];
      std::vector<Index> count(static_cast<std::size_t>(n), 0);
      for (const Index i : nodes) ++count[static_cast<std::size_t>(distance(nodes[0], i))];
      CHECK(widest_level(graph, components, c) == *std::max_element(count.begin(), count.end()));
    }
  }
}

TEST_CASE("neither nodes that are left out nor hubs make a level wide") {
  // Rows of ten nodes, and one more that all of them know, first and last.
  Random random;
  for (const Index hub : {0, 500}) {
    auto pairs = test::grid(50, 10);
    for (auto& [i, j] : pairs) {
      i += hub == 0;
      j += hub == 0;
    }
    for (Index i = 0; i < 500; ++i) pairs.emplace_back(hub, i + (hub == 0));
    const MeasurementGraph graph = test::simulate_graph(random, pairs, 0.1);
    const Components components = connected_components(graph);
    CHECK(widest_level(graph, components, 0) == 10);
    CHECK(widest_level(graph, components, 0, /*skipped=*/1) <= 20);
  }
}

TEST_CASE("an edge closes a cycle of one edge more than the tree path between its ends") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = test::scattered_graph(random);
    const BreadthFirstForest forest = breadth_first_forest(graph);
    std::vector<RelativeRotation> tree_edges;
    for (NodeId i = 0; i < graph.num_nodes(); ++i) {
      if (forest.parent[i] >= 0) tree_edges.push_back({i, forest.parent[i]});
    }
    const Eigen::MatrixXi tree_distance = distances(MeasurementGraph(tree_edges, graph.nodes()));
    std::vector<bool> in_tree(static_cast<std::size_t>(graph.num_edges()), false);
    for (const Index edge : forest.tree_edge) {
      if (edge >= 0) in_tree[edge] = true;
    }
    for (Index edge = 0; edge < graph.num_edges(); ++edge) {
      const Edge& e = graph.edges()[edge];
      const Index expected = in_tree[edge] ? 1 : tree_distance(e.i, e.j) + 1;
      REQUIRE(fundamental_cycle_length(graph, forest, edge) == expected);
    }
  }
}

TEST_CASE("an edge parallel to one of the forest closes a cycle of two edges") {
  const MeasurementGraph graph({{0, 1}, {1, 2}, {1, 0}});
  const BreadthFirstForest forest = breadth_first_forest(graph);
  CHECK(fundamental_cycle_length(graph, forest, 0) == 1);
  CHECK(fundamental_cycle_length(graph, forest, 1) == 1);
  CHECK(fundamental_cycle_length(graph, forest, 2) == 2);
}

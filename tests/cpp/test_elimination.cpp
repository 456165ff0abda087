#include <algorithm>
#include <limits>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/problem/connection.hpp>

#include "support/blocks.hpp"
#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using Eigen::MatrixXd;
using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr double no_limit = std::numeric_limits<double>::infinity();

/// Components of several sizes whose nodes are mixed, parallel edges in both directions, and nodes
/// without edges.
MeasurementGraph mixed_graph(Random& random) {
  std::vector<NodeId> ids;
  test::Pairs pairs;
  Index begin = 0;
  for (const Index n : {12, 1, 2, 7, 1}) {
    if (n > 1) {
      for (auto [i, j] : test::random_connected(random, n, random.below(4 * n))) {
        pairs.emplace_back(begin + i, begin + j);
      }
    }
    for (Index k = 0; k < n; ++k) ids.push_back(begin++);
  }
  std::shuffle(ids.begin(), ids.end(), random.generator());
  std::vector<RelativeRotation> measurements;
  for (const auto& [i, j] : pairs) {
    measurements.push_back({i, j, random.rotation(), random.power_of_ten(-1, 1)});
  }
  return MeasurementGraph(measurements, ids);
}

/// The rows and columns of the nodes that have rows in the matrices.
template <int B>
MatrixXd part_of(const MatrixXd& A, const Elimination& elimination) {
  const Index n = elimination.size();
  MatrixXd part(B * n, B * n);
  for (Index a = 0; a < n; ++a) {
    for (Index b = 0; b < n; ++b) {
      part.block<B, B>(B * a, B * b) =
          A.block<B, B>(B * elimination.node(a), B * elimination.node(b));
    }
  }
  return part;
}

/// The scalar Laplacian of a whole graph, from its definition.
MatrixXd dense_laplacian(const MeasurementGraph& graph) {
  MatrixXd L = MatrixXd::Zero(graph.num_nodes(), graph.num_nodes());
  for (const Edge& e : graph.edges()) {
    L(e.i, e.i) += e.weight;
    L(e.j, e.j) += e.weight;
    L(e.i, e.j) -= e.weight;
    L(e.j, e.i) -= e.weight;
  }
  return L;
}

MatrixXd dense_connection_laplacian(const MeasurementGraph& graph) {
  MatrixXd A = -test::dense_measurements(graph);
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    A.block<3, 3>(3 * i, 3 * i) += graph.degree(i) * Matrix3::Identity();
  }
  return A;
}

}  // namespace

TEST_CASE("matrices of a component are those of the definition, without the nodes skipped") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = mixed_graph(random);
    const Components components = connected_components(graph);
    REQUIRE(components.size() >= 5);
    const MatrixXd L = dense_laplacian(graph), A = dense_connection_laplacian(graph);
    for (Index c = 0; c < components.size(); ++c) {
      const auto& nodes = components.nodes[c];
      for (const Index skipped : {0, 1, static_cast<Index>(nodes.size())}) {
        Elimination elimination(graph, components, c, skipped);
        REQUIRE(elimination.skipped() == skipped);
        REQUIRE(elimination.size() == static_cast<Index>(nodes.size()) - skipped);
        REQUIRE(elimination.root() == nodes.front());
        for (Index a = 0; a < elimination.size(); ++a) {
          REQUIRE(elimination.node(a) == nodes[a + skipped]);
        }
        const auto scalar = grounded_laplacian(graph, elimination);
        const MatrixXd sparse_L = test::dense_symmetric<1>(elimination.pattern(), scalar);
        REQUIRE((sparse_L - part_of<1>(L, elimination)).norm() <= 1e-14 * L.norm());
        const auto blocks = connection_laplacian(graph, elimination);
        const MatrixXd sparse_A = test::dense_symmetric<3>(elimination.pattern(), blocks);
        REQUIRE((sparse_A - part_of<3>(A, elimination)).norm() <= 1e-14 * A.norm());
      }
    }
  }
}

TEST_CASE("the pattern has each pair of neighbours once, however many edges join them") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = mixed_graph(random);
    const Components components = connected_components(graph);
    const MatrixXd L = dense_laplacian(graph);
    for (Elimination& elimination : grounded_eliminations(graph, components)) {
      const BlockPattern& pattern = elimination.pattern();
      const MatrixXd part = part_of<1>(L, elimination);
      REQUIRE(pattern.size() == elimination.size());
      for (Index b = 0; b < pattern.size(); ++b) {
        std::vector<Index> expected;
        for (Index a = b; a < pattern.size(); ++a) {
          if (part(a, b) != 0.0) expected.push_back(a);
        }
        const auto begin = pattern.row.begin();
        REQUIRE(std::vector<Index>(begin + pattern.start[b], begin + pattern.start[b + 1]) ==
                expected);
      }
    }
  }
}

TEST_CASE("one analysis serves matrices of every block size") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const MeasurementGraph graph = mixed_graph(random);
    const Components components = connected_components(graph);
    const MatrixXd L = dense_laplacian(graph), A = dense_connection_laplacian(graph);
    for (Elimination& elimination : grounded_eliminations(graph, components)) {
      BlockCholesky<1> scalar(elimination.symbolic());
      BlockCholesky<3> blocks(elimination.symbolic());
      REQUIRE(scalar.symbolic() == blocks.symbolic());
      REQUIRE(scalar.factorize(grounded_laplacian(graph, elimination)) ==
              CholeskyOutcome::positive_definite);
      // Twice the degrees on the diagonal are positive definite without any noise model.
      const auto values = elimination.assemble<3>(
          [&](Index i) -> Matrix3 { return 2.0 * graph.degree(i) * Matrix3::Identity(); },
          [&](Index edge) -> Matrix3 {
            return -graph.edges()[edge].weight * graph.edges()[edge].i_from_j();
          });
      REQUIRE(blocks.factorize(values) == CholeskyOutcome::positive_definite);
      const MatrixXd x = test::normal_matrix(random, scalar.size(), 3);
      REQUIRE((scalar.solve(part_of<1>(L, elimination) * x) - x).norm() <= 1e-10 * x.norm());
      const MatrixXd y = test::normal_matrix(random, blocks.size(), 2);
      MatrixXd doubled = part_of<3>(A, elimination);
      doubled.diagonal() *= 2.0;
      REQUIRE((blocks.solve(doubled * y) - y).norm() <= 1e-10 * y.norm());
    }
  }
}

TEST_CASE("what was made ready says the same as what is made when it is asked for") {
  Random random;
  INFO(random.replay());
  constexpr double none = 0.0, little = 300.0, any = 1e300;
  for (int k = 0; k < 100; ++k) {
    const MeasurementGraph graph = mixed_graph(random);
    const Components components = connected_components(graph);
    for (const double max_flops : {none, little, any}) {
      std::vector<Elimination> ready = grounded_eliminations(graph, components);
      std::vector<Elimination> asked = grounded_eliminations(graph, components);
      for (std::size_t c = 0; c < ready.size(); ++c) {
        ready[c].prepare(max_flops);
        REQUIRE_FALSE(ready[c].has_order());
        for (const double limit : {little, any}) {
          for (const int B : {1, 3}) REQUIRE(ready[c].flops(B, limit) == asked[c].flops(B, limit));
          REQUIRE(ready[c].has_order() == asked[c].has_order());
        }
        REQUIRE(ready[c].nonzeros() == asked[c].nonzeros());
        REQUIRE(ready[c].factor_bytes(3) == asked[c].factor_bytes(3));
        REQUIRE(ready[c].symbolic()->node() == asked[c].symbolic()->node());
      }
    }
  }
}

TEST_CASE("beyond the limit flops are a lower bound beyond it, otherwise all there are") {
  Random random;
  INFO(random.replay());
  int only_bounds = 0;
  for (int k = 0; k < 200; ++k) {
    const Index n = 2 + random.below(30);
    test::Pairs pairs;
    switch (k % 4) {
      case 0:  // many parallel edges
        for (int times = 0; times < 20; ++times) {
          for (const auto& pair : test::path(n)) pairs.push_back(pair);
        }
        break;
      case 1:  // a star, whose hub is the root: nothing but a diagonal is left
        for (Index i = 1; i < n; ++i) pairs.emplace_back(0, i);
        break;
      case 2:
        pairs = test::complete(n);
        break;
      default:
        pairs = test::random_connected(random, n, random.below(4 * n));
    }
    const MeasurementGraph graph = test::simulate_graph(random, pairs, 0.1);
    const Components components = connected_components(graph);
    for (const Index skipped : {0, 1}) {
      for (const int B : {1, 3}) {
        Elimination unlimited(graph, components, 0, skipped);
        const double all = unlimited.flops(B, no_limit);
        for (const double limit : {0.0, 0.1 * all, 0.5 * all, 0.99 * all, all, 2.0 * all}) {
          Elimination elimination(graph, components, 0, skipped);
          const double flops = elimination.flops(B, limit);
          CAPTURE(n);
          CAPTURE(limit);
          CAPTURE(all);
          REQUIRE(flops <= all);
          if (limit >= all) REQUIRE(flops == all);
          if (limit < all) REQUIRE(flops > limit);
          only_bounds += flops < all ? 1 : 0;
          REQUIRE(elimination.flops(B, no_limit) == all);
          REQUIRE(elimination.flops(B, limit) == all);  // as it is known now
        }
        REQUIRE(all >= 2.0 * B * B * B * unlimited.size());
      }
    }
  }
  CHECK(only_bounds > 100);
}

TEST_CASE("flops of complete graphs are those of dense factorisations, n^3 / 3 and so on") {
  Random random;
  for (const Index n : {2, 10, 100}) {
    const MeasurementGraph graph = test::simulate_graph(random, test::complete(n + 1), 0.1);
    const Components components = connected_components(graph);
    Elimination elimination(graph, components, 0);
    CHECK(elimination.flops(1, no_limit) == n * (n + 1.0) * (n + 2.0) / 3.0);
    CHECK(elimination.flops(3, no_limit) == 9.0 * n * (n + 1.0) * (n + 2.0));
  }
}

TEST_CASE("a component of one node has nothing to eliminate") {
  const MeasurementGraph graph({{0, 1}}, {0, 1, 2});
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  REQUIRE(eliminations.size() == 2);
  Elimination& elimination = eliminations[1];
  CHECK(elimination.size() == 0);
  CHECK(elimination.root() == 2);
  CHECK(elimination.flops(3, 0.0) == 0.0);
  CHECK(elimination.pattern().size() == 0);
  BlockCholesky<1> cholesky(elimination.symbolic());
  CHECK(cholesky.factorize(grounded_laplacian(graph, elimination)) ==
        CholeskyOutcome::positive_definite);
  CHECK(cholesky.size() == 0);
}

TEST_CASE("any work at all exceeds a limit of zero") {
  Random random;
  const MeasurementGraph graph = test::simulate_graph(random, test::path(2), 0.1);
  const Components components = connected_components(graph);
  CHECK(Elimination(graph, components, 0).flops(3, 0.0) > 0.0);
}

TEST_CASE("a look at a random graph tells what its factorisation takes, within a factor") {
  Random random;
  INFO(random.replay());
  const Index n = 1500;
  for (const double extra : {0.1, 0.5, 1.0, 3.0, 7.0}) {
    CAPTURE(extra);
    const auto more = static_cast<Index>(extra * n);
    const MeasurementGraph graph =
        test::simulate_graph(random, test::random_connected(random, n, more), 0.1);
    const Components components = connected_components(graph);
    Elimination elimination(graph, components, 0);
    const double likely = elimination.likely_flops(3);
    CHECK(likely == doctest::Approx(27.0 * elimination.likely_flops(1)));
    CHECK_FALSE(elimination.has_order());
    const double factor = likely / elimination.flops(3, no_limit);
    CHECK(factor > 0.2);
    CHECK(factor < 5.0);
  }
  const MeasurementGraph chain = test::simulate_graph(random, test::path(n), 0.1);
  const Components components = connected_components(chain);
  CHECK(Elimination(chain, components, 0).likely_flops(1) == 0.0);
}

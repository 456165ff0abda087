// The certificate matrix S = Lambda - Rt, entry by entry.

#include <cmath>

#include <doctest/doctest.h>

#include <rotavg/certify/certificate_impl.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>

#include "support/blocks.hpp"
#include "support/certificate_at.hpp"
#include "support/certificates.hpp"
#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::CertificateAt;
using rotavg::test::descend;
using rotavg::test::Random;
using rotavg::test::small_graph;

namespace {

/// Of six nodes, over 100 for each.
MeasurementGraph parallel_edges(Random& random) {
  std::vector<RelativeRotation> edges;
  for (int k = 0; k < 900; ++k) {
    edges.push_back({k % 6, (k + 1 + k % 5) % 6, random.rotation(), random.uniform(0.5, 2.0)});
  }
  return MeasurementGraph(edges);
}

}  // namespace

TEST_CASE("sums at the nodes: what edges cost, and how far their blocks are from w I") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    // So many parallel edges that they are summed in parts, and a few.
    const MeasurementGraph graph = k < 5 ? parallel_edges(random) : small_graph(random, 0.5);
    const Rotations R = random.rotations(graph.num_nodes());
    const CertificateAt at(graph, R);
    std::vector<double> reach(R.size(), 0.0), cost(R.size(), 0.0);
    for (const Edge& e : graph.edges()) {
      const Matrix3 off = R[e.i] * e.i_from_j() * R[e.j].transpose() - Matrix3::Identity();
      for (const Index i : {e.i, e.j}) {
        reach[i] += e.weight * off.norm() / std::sqrt(2.0);  // its singular values are s, s and 0
        cost[i] += e.weight * off.squaredNorm();
      }
    }
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      REQUIRE(at.sums.reach(i) == doctest::Approx(reach[i]).epsilon(1e-12));
      REQUIRE(at.sums.cost(i) == doctest::Approx(cost[i]).epsilon(1e-12));
    }
  }
}

TEST_CASE("components measure the same by their nodes and by their edges") {
  Random random;
  INFO(random.replay());
  for (const double unit : {1e-100, 1.0, 1e97}) {
    std::vector<RelativeRotation> edges;
    for (int k = 0; k < 60; ++k) {
      const NodeId i = k % 7, j = (k + 1 + k / 7) % 7;
      if (i == j) continue;
      const NodeId other = k % 2 == 0 ? 0 : 10;  // component
      edges.push_back({other + i, other + j, random.rotation(), unit * random.uniform(1.0, 1e3)});
    }
    std::vector<NodeId> nodes{100};  // by itself
    for (NodeId i = 0; i < 7; ++i) nodes.insert(nodes.end(), {i, 10 + i});
    const MeasurementGraph graph(edges, nodes);
    const CertificateAt at(graph, random.rotations(graph.num_nodes()));
    REQUIRE(at.components.size() == 3);
    const auto by_nodes = detail::measure_by_nodes(at.sums, at.components);
    const auto by_edges = detail::measure_by_edges(at.residuals, at.components, {});
    for (std::size_t c = 0; c < 3; ++c) {
      INFO(unit, " ", c);
      REQUIRE(by_nodes[c].objective == doctest::Approx(by_edges[c].objective).epsilon(1e-12));
      REQUIRE(by_nodes[c].weight == doctest::Approx(by_edges[c].weight).epsilon(1e-12));
      REQUIRE(by_nodes[c].num_edges == by_edges[c].num_edges);
    }
  }
}

TEST_CASE("S is Lambda - Rt, as an operator and as a sparse matrix without its first nodes") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = small_graph(random, 0.5);
    const Rotations R = random.rotations(graph.num_nodes());
    const CertificateAt at(graph, R);
    const CertificateMatrix& S = at.S;
    const Eigen::MatrixXd dense =
        test::in_global_frame(test::dense_certificate_matrix(graph, R), R);
    const double tolerance = 1e-14 * dense.norm();
    const Eigen::Index size = dense.rows();
    REQUIRE((S.apply(Eigen::MatrixXd::Identity(size, size)) - dense).norm() < tolerance);
    for (const Index skipped : {0, 1}) {
      const Eigen::Index rest = size - 3 * skipped;
      Elimination elimination(graph, at.components, 0, skipped);
      const auto blocks = S.blocks(elimination);
      const Eigen::MatrixXd sparse = test::dense_symmetric<3>(elimination.pattern(), blocks);
      REQUIRE((sparse - dense.bottomRightCorner(rest, rest)).norm() < tolerance);
    }
    // tr(Lambda) = tr(R Rt R^T) at any R.
    const double trace_lambda = dense.trace();  // Rt has no diagonal blocks
    REQUIRE(trace_lambda == doctest::Approx(6.0 * graph.total_weight() - objective(graph, R))
                                .epsilon(1e-12)
                                .scale(graph.total_weight()));
  }
}

TEST_CASE("what S leaves of R^T is sqrt(2) / 4 of the gradient, and nothing where that vanishes") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const MeasurementGraph graph = small_graph(random, 0.3);
    const Rotations R = random.rotations(graph.num_nodes());
    const CertificateAt at(graph, R);
    const CertificateMatrix& S = at.S;
    const double root_n = std::sqrt(double(graph.num_nodes()));  // the null vectors have length one
    REQUIRE((S.apply(root_n * S.null_vectors()) - S.leftover()).norm() <
            1e-13 * graph.total_weight());
    REQUIRE(S.leftover().norm() ==
            doctest::Approx(std::sqrt(2.0) / 4.0 * gradient_norm(graph, R).absolute));

    const Rotations stationary = descend(graph, R);
    const CertificateAt there(graph, stationary);
    const CertificateMatrix& at_stationary = there.S;
    REQUIRE(at_stationary.leftover().norm() < 1e-12 * graph.total_weight());
    REQUIRE(at_stationary.apply(at_stationary.null_vectors()).norm() <
            1e-12 * graph.total_weight());
  }
}

// The certificate with full covariances: the split of every edge, S, and its bound.

#include <cmath>
#include <cstddef>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/global_operator.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/split.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/lobpcg.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/lie.hpp>

#include "support/anisotropic.hpp"
#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::anisotropic_graph;
using rotavg::test::Random;
using rotavg::test::residuals_at;
using rotavg::test::with_eigenvalues;

TEST_CASE("the split is admissible, and S is what it says") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 6, 8), 0.5);
    const Rotations R = random.rotations(graph.num_nodes());
    const AnisotropicResiduals at = residuals_at(graph, R);
    EdgeSplits splits(at);
    for (std::size_t e = 0; e < at().size(); ++e) {
      if (k % 2 == 1) splits.change(e, with_eigenvalues(random, {-5.0, 1.0, 20.0}));
      const Matrix3 W = splits.W(e);
      // -tr(P X) over rotations X is least at X = I, P = sym(G) - W.
      const Edge& edge = graph.scalar().edges()[e];
      const Matrix3& H = graph.precisions()[e];
      const Matrix3 M = 0.5 * H.trace() * Matrix3::Identity() - H;
      const Matrix3 G = R[edge.i] * edge.i_from_j() * M * R[edge.j].transpose();
      const Matrix3 P = symmetric_part(G) - W;
      for (int t = 0; t < 50; ++t) {
        const double more = P.trace() - (P * random.rotation()).trace();
        REQUIRE(more > -1e-12 * H.trace());
      }
    }
    const Components components = connected_components(graph.scalar());
    const AnisotropicCertificateMatrix S(splits, components, 0);
    const Eigen::MatrixXd dense = S.apply(Eigen::MatrixXd::Identity(S.size(), S.size()));
    const double scale = dense.norm();
    CHECK((dense - dense.transpose()).norm() < 1e-14 * scale);
    const Eigen::MatrixXd N = Matrix3::Identity().replicate(S.num_nodes(), 1);
    CHECK((dense * N - S.leftover()).norm() < 1e-13 * scale);
    CHECK((N.transpose() * dense * N).norm() < 1e-13 * scale);
    Elimination whole(graph.scalar(), components, 0, 0);
    const std::vector<double> none(graph.scalar().nodes().size(), 0.0);
    const auto blocks = S.blocks(whole, none);
    for (Index a = 0; a < whole.size(); ++a) {
      const auto& pattern = whole.pattern();
      for (Index e = pattern.start[static_cast<std::size_t>(a)];
           e < pattern.start[static_cast<std::size_t>(a) + 1]; ++e) {
        const auto entry = static_cast<std::size_t>(e);
        const Matrix3 expected = dense.block<3, 3>(3 * pattern.row[entry], 3 * a);
        REQUIRE((blocks[entry] - expected).norm() < 1e-13 * scale);
      }
    }
  }
}

TEST_CASE("no gap is less than what other rotations gain") {
  Random random;
  INFO(random.replay());
  int proved = 0;
  for (int k = 0; k < 60; ++k) {
    const double noise = k % 3 == 0 ? 0.05 : k % 3 == 1 ? 0.5 : 1.5;
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 3 + k % 6, 9), noise);
    double lowest = std::numeric_limits<double>::infinity();
    std::vector<Solution> found;
    for (int start = 0; start < 8; ++start) {
      SolveOptions options;
      if (start % 2 == 1) options.iteration.max_iterations = 2;  // not stationary
      found.push_back(solve(graph, options, random.rotations(graph.num_nodes())));
      lowest = std::min(lowest, found.back().objective);
    }
    for (const Solution& solution : found) {
      REQUIRE(std::isfinite(solution.certificate.gap));
      REQUIRE(solution.objective - solution.certificate.gap <= lowest * (1.0 + 1e-9));
      proved += solution.certificate.verdict == Verdict::proved;
    }
    const Certificate anywhere = certify(graph, random.rotations(graph.num_nodes()));
    CHECK(anywhere.verdict != Verdict::proved);
  }
  CHECK(proved > 60);
}

TEST_CASE("what is taken from firm edges, and M for a start at random, are parts of S") {
  Random random;
  INFO(random.replay());
  const AnisotropicGraph graph =
      anisotropic_graph(random, test::random_connected(random, 9, 12), 0.2);
  const AnisotropicResiduals at = residuals_at(graph, solve(graph).rotations);
  const EdgeSplits splits(at);
  const Components components = connected_components(graph.scalar());
  const AnisotropicCertificateMatrix S(splits, components, 0);
  constexpr double kappa = 0.3;
  const AnisotropicCertificateMatrix less = S.less_firm_edges(kappa);
  CHECK(S.leftover_edge_rounding() == 0.0);
  CHECK(less.leftover_edge_rounding() > 0.0);
  CHECK(less.leftover() == S.leftover());
  const Eigen::VectorXd x = random_start(S.size(), 1);
  double expected = 0.0;
  for (const auto& e : S.edges()) {
    const Matrix3 W = splits.W(static_cast<std::size_t>(e.edge));
    if (symmetric_eigen(W).values(0) < 1e-5 * W.norm()) continue;
    const Vector3 d = x.segment<3>(3 * e.i) - x.segment<3>(3 * e.j);
    expected += kappa * d.dot(W * d);
  }
  CHECK(x.dot(S.apply(x).col(0) - less.apply(x).col(0)) == doctest::Approx(expected));
  // S >= L_W - t diag(scale), L_W that of the firm edges.
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(S.size(), S.size());
  Eigen::MatrixXd below = S.apply(identity) - (S.apply(identity) - less.apply(identity)) / kappa;
  for (Eigen::Index r = 0; r < below.rows(); ++r) {
    below(r, r) += S.below_firm_edges() * S.scale(static_cast<Index>(r / 3));
  }
  CHECK(test::dense_eigenvalues(below)(0) > -1e-12 * below.norm());

  const GlobalOperator<2> M(S);
  const GlobalOperator<1> single(M);
  GlobalOperator<2>::Vectors z = M.random(7), Mz(z);
  for (auto& block : Mz) block.setZero();
  M.apply(z, 1.0, 0.0, 0.0, Mz);
  Eigen::MatrixXd dense(S.size(), 2);
  for (Index a = 0; a < S.num_nodes(); ++a) {
    dense.middleRows<3>(3 * a) = z[static_cast<std::size_t>(a)];
  }
  const Eigen::MatrixXd Sz = S.apply(dense);
  for (Index a = 0; a < S.num_nodes(); ++a) {
    const Eigen::MatrixXd row = Sz.middleRows<3>(3 * a) / S.scale(a);
    CHECK((row - Mz[static_cast<std::size_t>(a)]).norm() < 1e-13);
  }
  CHECK(M.products(z, z)[1] == doctest::Approx(1.0));
  Eigen::MatrixXd scaled = S.apply(identity);
  for (Eigen::Index r = 0; r < scaled.rows(); ++r) {
    for (Eigen::Index c = 0; c < scaled.cols(); ++c) {
      scaled(r, c) /=
          std::sqrt(S.scale(static_cast<Index>(r / 3)) * S.scale(static_cast<Index>(c / 3)));
    }
  }
  CHECK(test::dense_eigenvalues(scaled).maxCoeff() < 2.0);
}

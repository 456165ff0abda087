#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/anisotropic/bcd.hpp>
#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/global_operator.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/hessian.hpp>
#include <rotavg/anisotropic/minorant.hpp>
#include <rotavg/anisotropic/newton.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/split.hpp>
#include <rotavg/anisotropic/sum.hpp>
#include <rotavg/anisotropic/symmetric_eigen.hpp>
#include <rotavg/anisotropic/with_priors.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/lobpcg.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_precisions.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/solve_with_priors.hpp>
#include <rotavg/solve/staircase.hpp>

#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// V diag(a, b, c) V^T with random axes.
Matrix3 with_eigenvalues(Random& random, const Vector3& values) {
  const Matrix3 V = random.rotation();
  const Matrix3 H = V * values.asDiagonal() * V.transpose();
  return symmetric_part(H);
}

/// Measurements with noise of the covariance H^-1, H with eigenvalues up to 100 : 1, of about
/// `noise` radians.
AnisotropicGraph anisotropic_graph(Random& random, const test::Pairs& pairs, double noise) {
  const Rotations truth = random.rotations(test::num_nodes(pairs));
  std::vector<RelativeRotation> measurements;
  std::vector<Matrix3> precisions;
  for (const auto& [i, j] : pairs) {
    const Matrix3 V = random.rotation();
    Vector3 deviation, normal;
    for (int k = 0; k < 3; ++k) {
      deviation(k) = noise * random.power_of_ten(-1.0, 0.0);
      normal(k) = random.normal();
    }
    const Vector3 e = V * deviation.cwiseProduct(normal);
    measurements.push_back({i, j, truth[i].transpose() * truth[j] * exp_so3(e), 1.0});
    const Vector3 precision = deviation.cwiseProduct(deviation).cwiseInverse();
    precisions.push_back(symmetric_part(V * precision.asDiagonal() * V.transpose()));
  }
  return {MeasurementGraph(measurements), precisions};
}

/// sum 2 (tr M - tr(R_i R_ij M R_j^T)), M = tr(H) / 2 I - H.
double objective_by_definition(const AnisotropicGraph& graph, const Rotations& R) {
  double sum = 0.0;
  for (std::size_t k = 0; k < graph.precisions().size(); ++k) {
    const Edge& e = graph.scalar().edges()[k];
    const Matrix3& H = graph.precisions()[k];
    const Matrix3 M = 0.5 * H.trace() * Matrix3::Identity() - H;
    sum += 2.0 * (M.trace() - (R[e.i] * e.i_from_j() * M * R[e.j].transpose()).trace());
  }
  return sum;
}

AnisotropicResiduals residuals_at(const AnisotropicGraph& graph, const Rotations& R) {
  return {graph, to_quaternions(R), 1};
}

Rotations turned_by(const Rotations& R, const NodeVectors& w, double t) {
  Rotations next = R;
  for (std::size_t i = 0; i < R.size(); ++i) {
    next[i] = exp_so3(t * w.row(static_cast<Eigen::Index>(i)).transpose()) * R[i];
  }
  return next;
}

NodeVectors random_vectors(Random& random, Index n) {
  return NodeVectors::NullaryExpr(n, 3,
                                  [&](Eigen::Index, Eigen::Index) { return random.normal(); });
}

}  // namespace

TEST_CASE("eigenvalues of 3 x 3 matrices rise and rebuild the matrix") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 2000; ++k) {
    Vector3 values(random.normal(), random.normal(), random.normal());
    if (k % 3 == 0) values(1) = values(0);
    if (k % 5 == 0) values *= 1e-120;
    const Matrix3 A = with_eigenvalues(random, values);
    const SymmetricEigen eigen = symmetric_eigen(A);
    std::sort(values.data(), values.data() + 3);
    const double scale = values.cwiseAbs().maxCoeff();
    REQUIRE((eigen.values - values).cwiseAbs().maxCoeff() <= 1e-14 * scale);
    const Matrix3 again = eigen.vectors * eigen.values.asDiagonal() * eigen.vectors.transpose();
    REQUIRE((again - A).cwiseAbs().maxCoeff() <= 1e-14 * scale);
  }
}

TEST_CASE("the objective is that of general blocks in (20), and r^T H r for small r") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 50; ++k) {
    const Index n = 2 + random.below(8);
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, n, random.below(12)), 0.3);
    const Rotations R = random.rotations(graph.num_nodes());
    const double f = residuals_at(graph, R).objective();
    REQUIRE(f == doctest::Approx(objective_by_definition(graph, R)).epsilon(1e-12));
  }
  const Matrix3 H = with_eigenvalues(random, {1.0, 3.0, 10.0});
  const Matrix3 R_ij = random.rotation(), R_i = random.rotation();
  const AnisotropicGraph one(MeasurementGraph({{0, 1, R_ij}}), {H});
  const Vector3 r = 1e-6 * random.direction();
  const double f = residuals_at(one, {R_i, R_i * R_ij * exp_so3(r)}).objective();
  CHECK(f == doctest::Approx(r.dot(H * r)).epsilon(1e-9));
}

TEST_CASE("gradient and Hessian are those of finite differences") {
  Random random;
  INFO(random.replay());
  const AnisotropicGraph graph =
      anisotropic_graph(random, test::random_connected(random, 7, 8), 0.3);
  const Rotations R = random.rotations(graph.num_nodes());
  const AnisotropicResiduals at = residuals_at(graph, R);
  const double h = 1e-4, scale = graph.scalar().total_weight();
  for (int k = 0; k < 10; ++k) {
    const NodeVectors w = random_vectors(random, graph.num_nodes());
    const auto f = [&](double t) { return objective_by_definition(graph, turned_by(R, w, t)); };
    double slope = 0.0;
    for (Index i = 0; i < graph.num_nodes(); ++i) slope += at.gradient(i).dot(w.row(i));
    NodeVectors Hw;
    apply_hessian(at, w, Hw);
    CHECK(std::abs((f(h) - f(-h)) / (2.0 * h) - slope) < 1e-5 * scale);
    CHECK(std::abs((f(h) + f(-h) - 2.0 * f(0.0)) / (h * h) - w.cwiseProduct(Hw).sum()) <
          1e-4 * scale);
  }
  // The blocks are those of the product.
  const Components components = connected_components(graph.scalar());
  std::vector<Elimination> eliminations = grounded_eliminations(graph.scalar(), components);
  Elimination& elimination = eliminations[0];
  const auto blocks = hessian_blocks(at, elimination);
  const auto& pattern = elimination.pattern();
  NodeVectors unit = NodeVectors::Zero(graph.num_nodes(), 3), column;
  for (Index a = 0; a < elimination.size(); ++a) {
    for (int c = 0; c < 3; ++c) {
      unit.setZero();
      unit(elimination.node(a), c) = 1.0;
      apply_hessian(at, unit, column);
      for (Index e = pattern.start[static_cast<std::size_t>(a)];
           e < pattern.start[static_cast<std::size_t>(a) + 1]; ++e) {
        const auto entry = static_cast<std::size_t>(e);
        const Vector3 expected = column.row(elimination.node(pattern.row[entry])).transpose();
        REQUIRE((blocks[entry].col(c) - expected).norm() < 1e-12 * scale);
      }
    }
  }
}

TEST_CASE("any block is a rotation and a precision") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 500; ++k) {
    Matrix3 N;
    for (int e = 0; e < 9; ++e) N(e) = random.normal();
    const BlockMeasurement m = measurement_from_block(N);
    const Matrix3 M = 0.5 * m.precision.trace() * Matrix3::Identity() - m.precision;
    REQUIRE((m.i_from_j * M - N).norm() < 1e-12 * N.norm());
    REQUIRE(symmetric_eigen(m.precision).values(0) > -1e-12 * N.norm());
  }
}

TEST_CASE("precisions h I are the weights h / 2") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 12, 20), 0.3);
  test::spread_weights(random, 1.0, measurements);
  const MeasurementGraph graph(measurements);
  std::vector<Matrix3> precisions;
  for (const Edge& e : graph.edges()) precisions.push_back(2.0 * e.weight * Matrix3::Identity());
  const AnisotropicGraph same(graph, precisions);
  const Solution isotropic = solve(graph), solution = solve(same);
  CHECK(solution.objective == doctest::Approx(isotropic.objective).epsilon(1e-9));
  CHECK(solution.certificate.verdict == Verdict::proved);
  for (std::size_t i = 0; i < solution.rotations.size(); ++i) {
    CHECK((solution.rotations[i] - isotropic.rotations[i]).norm() < 1e-7);
  }
}

TEST_CASE("BCD, SUM and Newton fall to the same optimum, which is proved") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 8, 16), 0.1);
    SolveOptions options;
    std::optional<double> f;
    for (const Method method : {Method::automatic, Method::bcd, Method::sum, Method::newton}) {
      options.method = method;
      const Solution solution = solve(graph, options);
      REQUIRE(is_converged(solution.status));
      for (std::size_t t = 1; t < solution.trace.size() && method != Method::automatic; ++t) {
        const double before = solution.trace[t - 1].objective;
        REQUIRE(solution.trace[t].objective <= before * (1.0 + 1e-12));
      }
      if (!f) f = solution.objective;
      REQUIRE(solution.objective == doctest::Approx(*f).epsilon(1e-9));
      REQUIRE(solution.certificate.verdict == Verdict::proved);
    }
    options.method = Method::sum;
    options.mu = MuRule::min_eigenvalue;
    REQUIRE(solve(graph, options).objective == doctest::Approx(*f).epsilon(1e-6));
  }
}

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

TEST_CASE("no rotations cost less than the minorant says, whose gradient and Hessian are its own") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 6, 8), 0.3);
    const Rotations R = random.rotations(graph.num_nodes());
    const Minorant minorant(graph, to_quaternions(R), 1);
    const Components components = connected_components(graph.scalar());
    const LiftedProblemOf<Minorant> problem(minorant, components, 0);
    // By its definition, and below f, at other rotations Y_i = Z_i^T R_i.
    const Rotations other = random.rotations(graph.num_nodes());
    LiftedBlocks Z(3 * graph.num_nodes(), 3);
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      Z.middleRows<3>(3 * i) = R[i] * other[i].transpose();
    }
    double expected = 0.0;
    for (std::size_t e = 0; e < graph.precisions().size(); ++e) {
      const Edge& edge = graph.scalar().edges()[e];
      const Matrix3 W =
          half_trace_less(graph.precisions()[e] - closed_form_split(graph.precisions()[e]));
      CHECK(symmetric_eigen(W).values(0) > -1e-13 * graph.precisions()[e].trace());
      const Matrix3 D = other[edge.i] * edge.i_from_j() - other[edge.j];
      expected += (D * W * D.transpose()).trace();
    }
    const double f = residuals_at(graph, other).objective();
    CHECK(problem.objective(Z) == doctest::Approx(expected).epsilon(1e-9));
    CHECK(expected <= f * (1.0 + 1e-12));
    // Derivatives in five dimensions.
    LiftedBlocks wide = LiftedBlocks::Zero(Z.rows(), 5), V(wide);
    wide.leftCols(3) = Z;
    for (Eigen::Index e = 0; e < V.size(); ++e) V(e) = random.normal();
    problem.project(wide, V);
    const LiftedPoint at = problem.evaluate(wide);
    const double h = 1e-5, scale = graph.scalar().total_weight();
    const double up = problem.objective(problem.retract(wide, h * V)),
                 down = problem.objective(problem.retract(wide, -h * V));
    CHECK(std::abs((up - down) / (2.0 * h) - at.gradient.cwiseProduct(V).sum()) < 1e-5 * scale);
    const LiftedBlocks change = (problem.evaluate(problem.retract(wide, h * V)).gradient -
                                 problem.evaluate(problem.retract(wide, -h * V)).gradient) /
                                (2.0 * h);
    LiftedBlocks tangent = change;
    problem.project(wide, tangent);
    CHECK((tangent - problem.hessian(at, V)).norm() < 1e-4 * scale);
  }
}

TEST_CASE("from a ring that is wound once the staircase comes down unwound") {
  Random random;
  INFO(random.replay());
  const Index n = 16;
  std::vector<RelativeRotation> measurements;
  std::vector<Matrix3> precisions;
  for (Index ring = 0; ring < 2; ++ring) {  // two components
    for (const auto& [i, j] : test::cycle(n)) {
      measurements.push_back({100 * ring + i, 100 * ring + j, exp_so3(0.01 * random.direction())});
      precisions.push_back(with_eigenvalues(random, {1.0, ring == 0 ? 3.0 : 1.0, 30.0}));
    }
  }
  const AnisotropicGraph graph(MeasurementGraph(measurements), precisions);
  Rotations start = test::twisted(n, 1);
  const Rotations other = test::twisted(n, -1);
  start.insert(start.end(), other.begin(), other.end());
  SolveOptions options;
  options.max_rank = 0;
  options.method = Method::newton;
  const Solution stuck = solve(graph, options, start);
  REQUIRE(stuck.objective > 1.0);
  CHECK(stuck.certificate.verdict == Verdict::not_certified);
  for (const Method method : {Method::automatic, Method::staircase}) {
    options.max_rank = 10;
    options.method = method;
    const Solution solution = solve(graph, options, stuck.rotations);
    CHECK(solution.objective < 0.1 * stuck.objective);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(solution.rotations[n] == Matrix3::Identity());
  }
}

TEST_CASE("the staircase's bound lies below all rotations") {
  Random random;
  INFO(random.replay());
  int bounded = 0;
  for (int k = 0; k < 20; ++k) {
    CAPTURE(k);
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 8, 8), 1.5);
    SolveOptions options;
    double lowest = std::numeric_limits<double>::infinity(), lower = 0.0;
    for (int start = 0; start < 6; ++start) {
      const Solution solution = solve(graph, options, random.rotations(graph.num_nodes()));
      lowest = std::min(lowest, solution.objective);
      lower = std::max(lower, solution.objective - solution.certificate.gap);
      bounded += solution.certificate.method == CertificateMethod::relaxation;
    }
    CHECK(lower <= lowest * (1.0 + 1e-9));
  }
  CHECK(bounded > 0);
}

TEST_CASE("without noise every graph is proved, and several components are") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::grid(4, 5);
  for (const auto& [i, j] : test::cycle(6)) pairs.emplace_back(20 + i, 20 + j);
  for (const double noise : {1e-7, 1e-6, 1e-3, 0.05}) {
    const Solution solution = solve(anisotropic_graph(random, pairs, noise));
    CHECK(solution.components.size() == 2);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(solution.rotations[20] == Matrix3::Identity());
  }
}

TEST_CASE("results have the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  const AnisotropicGraph graph =
      anisotropic_graph(random, test::random_connected(random, 200, 400), 0.2);
  for (const Method method : {Method::automatic, Method::sum, Method::staircase}) {
    SolveOptions options;
    options.method = method;
    options.iteration.num_threads = 1;
    const Solution one = solve(graph, options);
    options.iteration.num_threads = 3;
    const Solution three = solve(graph, options);
    CHECK(one.rotations == three.rotations);
    CHECK(one.certificate.gap == three.certificate.gap);
  }
}

TEST_CASE("fixed and absolute rotations, and rigs, turn precisions with them") {
  Random random;
  INFO(random.replay());
  const test::Pairs pairs = test::complete(7);
  const AnisotropicGraph graph = anisotropic_graph(random, pairs, 0.05);
  const Solution free = solve(graph);
  // What agrees with the optimum moves nothing: here a fixed node, an absolute prior and a rig.
  const Matrix3 turn = random.rotation();
  Priors priors;
  priors.fixed.push_back({0, turn * free.rotations[0]});
  priors.absolute.push_back({1, turn * free.rotations[1], 40.0});
  priors.rigs.push_back({2, 0, free.rotations[2].transpose() * free.rotations[2]});
  priors.rigs.push_back({3, 0, free.rotations[2].transpose() * free.rotations[3]});
  const GroundedGraph problem(graph.scalar(), priors);
  const Solution start = solve(problem, SolveOptions{}, std::nullopt, false);
  const Solution solution = solve(problem, {graph.precisions()}, SolveOptions{}, start.rotations);
  CHECK(solution.certificate.verdict == Verdict::proved);
  for (std::size_t i = 0; i < free.rotations.size(); ++i) {
    CHECK((solution.rotations[i] - turn * free.rotations[i]).norm() < 1e-6);
  }
}

TEST_CASE("gravity is of precision w (I - g g^T), and a free heading keeps nothing from a proof") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 12; ++k) {
    const AnisotropicGraph graph =
        anisotropic_graph(random, test::random_connected(random, 8, 8), 0.05);
    const Solution free = solve(graph);
    Priors priors;
    priors.down = random.direction();
    const double w = graph.degree(0) * random.power_of_ten(-1.0, 1.0);
    const Matrix3 world = random.rotation();
    for (const Index node : {1, 3, 6}) {
      const Matrix3 tilt = exp_so3(0.05 * random.direction());
      const Vector3 down = tilt * free.rotations[node].transpose() * world * priors.down;
      priors.gravity.push_back({node, down, w * (1.0 + node)});
    }
    if (k % 3 == 0) {
      const Matrix3 near = exp_so3(0.1 * random.direction());
      priors.absolute.push_back({5, near * world.transpose() * free.rotations[5], 0.2 * w});
    }
    const GroundedGraph problem(graph.scalar(), priors);
    const GroundedPrecisions precisions{graph.precisions(), 3.0};
    const AnisotropicGraph grounded = anisotropic_graph(problem, precisions);
    CHECK(grounded.free_axes().size() == (k % 3 == 0 ? 0 : 1));
    Rotations R = random.rotations(grounded.num_nodes());
    R[0].setIdentity();
    const Rotations nodes = problem.nodes_from(R);
    double expected = objective_by_definition(graph, nodes);
    for (const auto& p : problem.priors().gravity) {
      expected += 3.0 * p.weight * (nodes[p.node] * p.down - problem.priors().down).squaredNorm();
    }
    for (const auto& p : problem.priors().absolute) {
      expected += 1.5 * p.weight * (nodes[p.node] - p.world_from_node).squaredNorm();
    }
    CHECK(residuals_at(grounded, R).objective() == doctest::Approx(expected).epsilon(1e-12));
    const Solution start = solve(problem, SolveOptions{}, std::nullopt, false);
    const Solution solution = solve(problem, precisions, SolveOptions{}, start.rotations);
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(certify(problem, precisions, solution.rotations).verdict == Verdict::proved);
    // Elsewhere the bound holds, and is not what is called proved.
    for (const double angle : {1e-3, 0.1, 2.0}) {
      Rotations other = solution.rotations;
      for (Matrix3& R_i : other) R_i = exp_so3(angle * random.direction()) * R_i;
      const Certificate there = certify(problem, precisions, other);
      CHECK(there.verdict != Verdict::proved);
      const double f = residuals_at(grounded, problem.variables_from(other)).objective();
      CHECK(f - there.gap <= solution.objective * (1.0 + 1e-9));
    }
  }
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
  Eigen::MatrixXd scaled = S.apply(Eigen::MatrixXd::Identity(S.size(), S.size()));
  for (Eigen::Index r = 0; r < scaled.rows(); ++r) {
    for (Eigen::Index c = 0; c < scaled.cols(); ++c) {
      scaled(r, c) /=
          std::sqrt(S.scale(static_cast<Index>(r / 3)) * S.scale(static_cast<Index>(c / 3)));
    }
  }
  CHECK(test::dense_eigenvalues(scaled).maxCoeff() < 2.0);
}

TEST_CASE("what is no precision is refused by its edge") {
  const MeasurementGraph graph({{0, 1, Matrix3::Identity()}, {1, 2, Matrix3::Identity()}});
  const Matrix3 I = Matrix3::Identity();
  Matrix3 negative = I, skew = I, nan = I;
  negative(2, 2) = -1.0;
  skew(0, 1) = 0.5;
  nan(1, 1) = std::numeric_limits<double>::quiet_NaN();
  for (const Matrix3& bad : {negative, skew, nan, Matrix3(Matrix3::Zero())}) {
    try {
      const AnisotropicGraph refused(graph, {I, bad});
      FAIL("not refused");
    } catch (const InvalidEdge& error) {
      CHECK(error.edge() == 1);
    }
  }
  CHECK_THROWS_AS(AnisotropicGraph(graph, {I}), std::invalid_argument);
}

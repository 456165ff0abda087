#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/robust/cycles.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/reweighted_sweep.hpp>
#include <rotavg/robust/settling.hpp>
#include <rotavg/robust/votes.hpp>
#include <rotavg/rotavg.hpp>
#include <rotavg/solve/monitor.hpp>

#include "support/contaminated.hpp"
#include "support/folded_ring.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::contaminated;
using rotavg::test::Random;

namespace {

/// The largest angle between two sets of rotations after those of node 0 were laid on each other.
double largest_error(const Rotations& R, const Rotations& truth) {
  double error = 0.0;
  for (std::size_t i = 0; i < R.size(); ++i) {
    error =
        std::max(error, angle_between(truth[0].transpose() * truth[i], R[0].transpose() * R[i]));
  }
  return error;
}

}  // namespace

TEST_CASE("set_weights is the graph made with these weights") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 20, 40), 0.3);
  MeasurementGraph graph(measurements);
  std::vector<double> weights;
  for (RelativeRotation& m : measurements) weights.push_back(m.weight = random.power_of_ten(-6, 3));
  graph.set_weights(weights);
  const MeasurementGraph anew(measurements);
  CHECK(graph.total_weight() == anew.total_weight());
  CHECK(graph.min_weight() == anew.min_weight());
  CHECK(graph.max_weight() == anew.max_weight());
  const Rotations R = random.rotations(20);
  CHECK(objective(graph, R) == doctest::Approx(objective(anew, R)).epsilon(1e-13));
  const auto g = gradient(graph, R), g_anew = gradient(anew, R);
  for (Index i = 0; i < 20; ++i) {
    CHECK(graph.degree(i) == anew.degree(i));
    CHECK((g[i] - g_anew[i]).norm() <= 1e-12 * graph.degree(i));
  }
  weights[3] = -1.0;
  CHECK_THROWS_AS(graph.set_weights(weights), InvalidEdge);
  CHECK(graph.edges()[3].weight == measurements[3].weight);
  CHECK_THROWS_AS(graph.set_weights({1.0}), std::invalid_argument);
}

TEST_CASE("the robust objective of l2 is f, and its gradient that of the weighted problem") {
  Random random;
  INFO(random.replay());
  MeasurementGraph graph(test::simulate(random, test::complete(7), 0.6));
  const Rotations R = random.rotations(7);
  const std::vector<double> given = graph.weights();
  std::vector<double> x;
  const auto value = [&](const Rotations& at, const RobustLoss& loss) {
    graph.set_weights(given);
    squared_residuals(graph, to_quaternions(at), 1, x);
    return robust_objective(given, x, loss, {}, 1);
  };
  CHECK(value(R, {Loss::l2}) == doctest::Approx(objective(graph, R)).epsilon(1e-12));
  for (const Loss kind : {Loss::huber, Loss::l1, Loss::l_half, Loss::cauchy, Loss::geman_mcclure}) {
    const RobustLoss loss{kind, 0.3};
    std::vector<double> weights;
    value(R, loss);
    robust_weights(given, x, loss, {}, 1, weights);
    graph.set_weights(given);
    const std::vector<double> ones;
    RobustResiduals residuals(graph, ones, 1);
    residuals.update(to_quaternions(R), loss);
    CHECK(residuals.objective() == doctest::Approx(value(R, loss)).epsilon(1e-12));
    for (std::size_t k = 0; k < weights.size(); ++k) {
      CHECK(residuals.weights()[k] == doctest::Approx(weights[k]).epsilon(1e-12));
    }
    graph.set_weights(weights);
    const auto g = gradient(graph, R);
    for (Index i = 0; i < 7; ++i) {
      CHECK((residuals.gradient(i) - g[i]).norm() == doctest::Approx(0.0).epsilon(1e-9));
    }
    for (Index i = 0; i < 7; ++i) {
      const Vector3 direction = random.direction();
      constexpr double h = 1e-5;
      Rotations plus = R, minus = R;
      plus[i] = exp_so3(h * direction) * R[i];
      minus[i] = exp_so3(-h * direction) * R[i];
      const double slope = (value(plus, loss) - value(minus, loss)) / (2.0 * h);
      CHECK(slope == doctest::Approx(g[i].dot(direction)).epsilon(1e-6).scale(1.0));
    }
  }
}

TEST_CASE("a sweep of votes never lets the objective rise, and frees a node that is held wrong") {
  Random random;
  INFO(random.replay());
  const auto [graph, truth, is_wrong] = contaminated(random, test::complete(30), 0.02, 0.5);
  const std::vector<double> weights = graph.weights();
  const RobustLoss loss{Loss::geman_mcclure, 0.06};
  Quaternions q = to_quaternions(truth);
  for (Index i = 0; i < 10; ++i) q[i] = to_quaternion(random.rotation());
  const auto value = [&] {
    std::vector<double> x;
    squared_residuals(graph, q, 1, x);
    return robust_objective(weights, x, loss, {}, 1);
  };
  const double before = value();
  std::vector<bool> open(30, true);
  CHECK(vote_sweep(graph, weights, {}, loss, q, open) >= 10);
  CHECK(value() < before);
  CHECK(largest_error(to_rotations(q), truth) < 0.3);
  while (vote_sweep(graph, weights, {}, loss, q, open) > 0) CHECK(value() < before);
  // Nodes that are no longer open have nothing to gain.
  open.assign(30, true);
  CHECK(vote_sweep(graph, weights, {}, loss, q, open) == 0);
}

TEST_CASE("solve_robust finds the truth behind wrong edges, names these, and proves the rest") {
  Random random;
  INFO(random.replay());
  const auto [graph, truth, is_wrong] = contaminated(random, test::complete(40), 0.03, 0.4);
  CHECK(largest_error(solve(graph).rotations, truth) > 0.1);
  for (const Loss kind : {Loss::automatic, Loss::huber, Loss::l1, Loss::l_half, Loss::cauchy,
                          Loss::geman_mcclure, Loss::tls}) {
    CAPTURE(static_cast<int>(kind));
    RobustOptions robust;
    robust.loss = kind;
    const RobustSolution solution = solve_robust(graph, {}, robust);
    CHECK(is_converged(solution.status));
    CHECK(solution.certificate.verdict == Verdict::proved);
    CHECK(largest_error(solution.rotations, truth) < (kind == Loss::huber ? 0.12 : 0.06));
    // What is certified is the problem with the final weights.
    MeasurementGraph weighted = graph;
    weighted.set_weights(solution.edge_weights);
    CHECK(objective(weighted, solution.rotations) ==
          doctest::Approx(solution.objective).epsilon(1e-9));
    CHECK(certify(weighted, solution.rotations).verdict == Verdict::proved);
    CHECK(solution.noise == doctest::Approx(0.03).epsilon(0.25));
    for (std::size_t k = 1; k < solution.trace.size(); ++k) {
      CHECK(solution.trace[k].objective <= solution.trace[k - 1].objective * (1.0 + 1e-12));
    }
    CHECK(solution.robust_objective <= solution.trace.back().objective * (1.0 + 1e-9));
    Index missed = 0, accused = 0;
    for (std::size_t k = 0; k < is_wrong.size(); ++k) {
      const bool outlier = is_outlier(solution.verdicts.edges[k]);
      missed += is_wrong[k] && !outlier;
      accused += !is_wrong[k] && outlier;
      CHECK(solution.edge_weights[k] >= 0.99e-9);
      CHECK(solution.edge_weights[k] <= 1.0 + 1e-12);
    }
    CHECK(missed <= 8);    // random rotations can be right
    CHECK(accused <= 16);  // 0.3 % of a normal distribution, and what fitting adds
  }
}

TEST_CASE("without noise wrong edges leave no trace; a forest and single edges are met exactly") {
  Random random;
  INFO(random.replay());
  const auto clean = contaminated(random, test::complete(20), 0.0, 0.3);
  const RobustSolution solution = solve_robust(clean.graph);
  CHECK(largest_error(solution.rotations, clean.truth) < 1e-5);
  CHECK(solution.loss.scale > 0.0);

  const MeasurementGraph tree(test::simulate(random, test::path(5), 0.1));
  const RobustSolution exact = solve_robust(tree);
  CHECK(exact.objective < 1e-20);
  CHECK(exact.certificate.verdict == Verdict::proved);
  for (const EdgeVerdict verdict : exact.verdicts.edges) CHECK(verdict == EdgeVerdict::bridge);
  CHECK(*std::max_element(exact.verdicts.part.begin(), exact.verdicts.part.end()) == 0);
}

TEST_CASE("the results are the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  // Enough edges for several threads, and no multiple of four; few and sparse ones, too.
  const auto large = contaminated(random, test::complete(141), 0.05, 0.3);
  const auto sparse = contaminated(random, test::random_connected(random, 3000, 12000), 0.05, 0.4);
  REQUIRE(large.graph.num_edges() % 4 != 0);
  const MeasurementGraph folded(test::folded_ring(random, 80, 0.002, 6, 1).measurements);
  for (const MeasurementGraph* graph : {&large.graph, &sparse.graph, &folded}) {
    SolveOptions options;
    options.iteration.num_threads = 1;
    const RobustSolution one = solve_robust(*graph, options);
    options.iteration.num_threads = 3;
    const RobustSolution three = solve_robust(*graph, options);
    CHECK(one.rotations == three.rotations);
    CHECK(one.edge_weights == three.edge_weights);
    CHECK(one.robust_objective == three.robust_objective);
    REQUIRE(one.alternatives.size() == three.alternatives.size());
    for (std::size_t k = 0; k < one.alternatives.size(); ++k) {
      CHECK(one.alternatives[k].rotations == three.alternatives[k].rotations);
    }
  }
}

TEST_CASE("where edges are few and many wrong, what is met exactly is not taken for the truth") {
  Random random;
  INFO(random.replay());
  const auto problem = contaminated(random, test::grid(30, 30), 0.05, 0.2);
  for (const Loss kind : {Loss::l1, Loss::cauchy, Loss::automatic}) {
    CAPTURE(static_cast<int>(kind));
    RobustOptions robust;
    robust.loss = kind;
    const RobustSolution solution = solve_robust(problem.graph, {}, robust);
    CHECK(solution.noise > 0.02);
    CHECK(solution.noise < 0.15);
    Index accused = 0, right = 0;
    for (std::size_t k = 0; k < problem.is_wrong.size(); ++k) {
      right += !problem.is_wrong[k];
      accused += !problem.is_wrong[k] && is_outlier(solution.verdicts.edges[k]);
    }
    CHECK(accused < right / 5);
  }
}

TEST_CASE("noise that was taken for too much is looked at again, and the scale falls with it") {
  Random random;
  INFO(random.replay());
  const auto problem = contaminated(random, test::random_connected(random, 400, 4000), 0.01, 0.2);
  // Rotations bent by far more than the noise make the residuals that it is first estimated from.
  const SolveOptions options;
  MeasurementGraph graph = problem.graph;
  RobustRun run(graph, options, series_of(graph), {}, Stopwatch());
  Rotations bent = problem.truth;
  for (Matrix3& R : bent) R = exp_so3(0.1 * random.normal_vector()) * R;
  const Consensus consensus{bent, run.noise_at(bent), 0};
  REQUIRE(consensus.noise > 0.05);
  const double freedom = series_of(graph).freedom();
  const Settling settled = settle(run, {Loss::automatic, 0.0}, freedom, consensus, {}, true, 500);
  CHECK(settled.noise == doctest::Approx(0.01).epsilon(0.2));
  CHECK(settled.loss.scale ==
        doctest::Approx(default_scale(Loss::cauchy, freedom) * settled.noise));
  for (std::size_t k = 1; k < settled.result.trace.size(); ++k) {  // of one scale
    CHECK(settled.result.trace[k].objective <=
          settled.result.trace[k - 1].objective * (1.0 + 1e-12));
  }
  // A scale that was given stays.
  RobustRun again(graph, options, series_of(graph), {}, Stopwatch());
  const Settling given = settle(again, {Loss::automatic, 0.03}, freedom, consensus, {}, true, 500);
  CHECK(given.loss.scale == 0.03);
  CHECK(given.noise == doctest::Approx(0.01).epsilon(0.2));
}

TEST_CASE("two groups that only wrong edges join are weak parts, and stay one component") {
  Random random;
  INFO(random.replay());
  const Rotations truth = random.rotations(16);
  test::Pairs pairs;
  for (Index i = 0; i < 8; ++i) {
    for (Index j = i + 1; j < 8; ++j) {
      pairs.emplace_back(i, j);
      pairs.emplace_back(8 + i, 8 + j);
    }
  }
  auto measurements = test::measure(random, pairs, truth, 0.01);
  const std::size_t good = measurements.size();
  for (Index i = 0; i < 6; ++i) measurements.push_back({i, 8 + i, random.rotation(), 1.0});
  const MeasurementGraph graph(measurements);
  const RobustSolution solution = solve_robust(graph);
  CHECK(solution.components.size() == 1);
  Index weak = 0;
  for (std::size_t k = 0; k < measurements.size(); ++k) {
    const EdgeVerdict verdict = solution.verdicts.edges[k];
    if (k < good) CHECK(!is_outlier(verdict));
    weak += verdict == EdgeVerdict::weak_part;
  }
  const auto& part = solution.verdicts.part;
  const bool joined = part[0] == part[8];  // by an edge that happens to be met
  CHECK(weak == (joined ? 0 : 6));
  for (Index i = 1; i < 8; ++i) {
    CHECK(part[i] == part[0]);
    CHECK(part[8 + i] == part[8]);
  }
}

TEST_CASE("bridges are the edges without which the graph has one component more") {
  Random random;
  INFO(random.replay());
  for (int repeat = 0; repeat < 40; ++repeat) {
    const Index n = 2 + random.below(12);
    const auto measurements =
        test::simulate(random, test::random_connected(random, n, random.below(n)), 0.0);
    const MeasurementGraph graph(measurements);
    const std::vector<bool> found = bridges(graph);
    for (std::size_t k = 0; k < measurements.size(); ++k) {
      std::vector<bool> holds(measurements.size(), true);
      holds[k] = false;
      const auto part = parts_joined_by(graph, holds);
      CHECK(found[k] == (*std::max_element(part.begin(), part.end()) == 1));
    }
  }
}

TEST_CASE("cycle evidence counts the triangles of a small graph") {
  const auto turn = [](double angle) { return exp_so3({0.0, 0.0, angle}); };
  // 0-1-2 closes within 0.05; 0-1-3 misses by 0.5; 3-4 is in no triangle
  const MeasurementGraph graph({{0, 1, turn(0.0)},
                                {1, 2, turn(0.3)},
                                {0, 2, turn(0.35)},
                                {1, 3, turn(0.0)},
                                {0, 3, turn(0.5)},
                                {3, 4, turn(1.0)}});
  const auto evidence = cycle_evidence(graph, 0.1);
  CHECK(evidence[0].checked == 2);
  CHECK(evidence[0].agreeing == 1);
  CHECK(evidence[0].share() == 0.5);
  CHECK(evidence[2].checked == 1);
  CHECK(evidence[2].agreeing == 1);
  CHECK(evidence[4].agreeing == 0);
  CHECK(evidence[5].checked == 0);
  CHECK(evidence[0].median_error == doctest::Approx(0.275).epsilon(1e-9));
  CHECK(evidence[0].least_error == doctest::Approx(0.05).epsilon(1e-9));
  CHECK(std::isnan(evidence[5].median_error));
  CHECK(std::isnan(evidence[5].least_error));
  CHECK(!cycle_evidence(graph, 0.04)[0].refuted());
  CHECK(cycle_evidence(graph, 0.04)[0].refuted(2));
  CHECK(cycle_evidence(graph, 0.6)[0].agreeing == 2);
  CHECK(cycle_evidence(graph, 0.04)[2].agreeing == 0);
  CHECK(cycle_evidence(graph, 0.06)[2].agreeing == 1);
}

TEST_CASE("the cycle check leaves wrong edges out from the start") {
  Random random;
  INFO(random.replay());
  const auto problem = contaminated(random, test::complete(30), 0.02, 0.2);
  RobustOptions robust;
  robust.cycle_threshold = 0.15;
  const RobustSolution solution = solve_robust(problem.graph, {}, robust);
  Index caught = 0, wrong = 0;
  for (std::size_t k = 0; k < problem.is_wrong.size(); ++k) {
    const bool refuted = solution.verdicts.edges[k] == EdgeVerdict::cycle_check;
    if (refuted) CHECK(problem.is_wrong[k]);
    if (refuted) CHECK(solution.edge_weights[k] <= 1.01e-6);
    caught += refuted;
    wrong += problem.is_wrong[k];
  }
  CHECK(caught > wrong / 2);
  CHECK(largest_error(solution.rotations, problem.truth) < 0.04);
}

TEST_CASE("limits and callbacks stop a robust solution, and it says so") {
  Random random;
  INFO(random.replay());
  const auto problem = contaminated(random, test::complete(30), 0.05, 0.4);
  SolveOptions options;
  options.iteration.max_iterations = 0;
  CHECK(solve_robust(problem.graph, options).status == Status::iteration_limit);
  options.iteration.max_iterations = 7;
  const RobustSolution limited = solve_robust(problem.graph, options);
  CHECK(limited.status == Status::iteration_limit);
  CHECK(limited.iterations <= 7);
  options.iteration.max_iterations = 20000;
  options.iteration.time_limit = 0.0;
  CHECK(solve_robust(problem.graph, options).status == Status::time_limit);
  options.iteration.time_limit = 1e9;
  int calls = 0, last = 0;
  options.iteration.callback = [&](const Progress& progress) {
    CHECK(progress.iteration >= last);
    last = progress.iteration;
    return ++calls < 9;
  };
  CHECK(solve_robust(problem.graph, options).status == Status::stopped);
  CHECK(calls == 9);

  RobustOptions robust;
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {-1.0, std::nan(""), infinity, 5.0, 1e300, 1e-300}) {
    robust.scale = bad;
    CHECK_THROWS_AS(solve_robust(problem.graph, {}, robust), std::invalid_argument);
  }
  robust.scale = 0.0;
  for (const double bad : {-1.0, std::nan(""), 4.0}) {
    robust.cycle_threshold = bad;
    CHECK_THROWS_AS(solve_robust(problem.graph, {}, robust), std::invalid_argument);
  }
}

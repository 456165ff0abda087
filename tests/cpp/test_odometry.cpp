// Odometry that nobody called right: favoured by the automatic loss, doubted where enough speaks
// against it.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/checked_part.hpp>
#include <rotavg/robust/agreeing_closures.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/odometry.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/solve.hpp>

#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

struct Drive {
  Rotations truth;
  std::vector<RelativeRotation> measurements;  ///< odometry first
  std::vector<bool> is_odometry, is_wrong;

  MeasurementGraph graph() const { return MeasurementGraph(measurements); }
};

constexpr double step_noise = 0.005, closure_noise = 0.02;

Drive drive(Random& random, Index n) {
  Drive d;
  d.truth.push_back(Matrix3::Identity());
  while (static_cast<Index>(d.truth.size()) < n) {
    d.truth.push_back(d.truth.back() * exp_so3(0.2 * random.normal_vector()));
  }
  for (Index i = 0; i + 1 < n; ++i) {
    const Matrix3 seen =
        d.truth[i].transpose() * d.truth[i + 1] * exp_so3(step_noise * random.normal_vector());
    d.measurements.push_back({i, i + 1, seen, 0.5 / (step_noise * step_noise)});
    d.is_odometry.push_back(true);
    d.is_wrong.push_back(false);
  }
  return d;
}

/// A closure that says truth_i^T turn truth_j.
void close(Random& random, Drive& d, Index i, Index j, const Matrix3& turn, bool wrong) {
  const Matrix3 seen =
      d.truth[i].transpose() * turn * d.truth[j] * exp_so3(closure_noise * random.normal_vector());
  d.measurements.push_back({i, j, seen, 0.5 / (closure_noise * closure_noise)});
  d.is_odometry.push_back(false);
  d.is_wrong.push_back(wrong);
}

double mean_error(const Rotations& R, const Rotations& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < R.size(); ++i) {
    sum += angle_between(truth[0].transpose() * truth[i], R[0].transpose() * R[i]);
  }
  return sum / static_cast<double>(R.size());
}

double error_of_right_ones(const Drive& d) {
  std::vector<RelativeRotation> right;
  for (std::size_t k = 0; k < d.is_wrong.size(); ++k) {
    if (!d.is_wrong[k]) right.push_back(d.measurements[k]);
  }
  return mean_error(solve(MeasurementGraph(right)).rotations, d.truth);
}

RobustSolution solve_auto(const Drive& d, bool knows_odometry) {
  RobustOptions robust;
  robust.loss = Loss::automatic;
  if (knows_odometry) robust.known.odometry = d.is_odometry;
  SolveOptions options;
  options.certify = false;
  return solve_robust(d.graph(), options, robust);
}

}  // namespace

TEST_CASE("places taken for others do not bend odometry that is hardly ever wrong") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 800;
  Drive d = drive(random, n);
  for (int k = 0; k < 100; ++k) {
    const Index i = random.below(n - 60), j = i + 30 + random.below(n - i - 30);
    close(random, d, i, j, Matrix3::Identity(), false);
  }
  for (int place = 0; place < 6; ++place) {  // ten in a row agree
    const Index i = random.below(n / 2 - 12), j = n / 2 + random.below(n / 2 - 12);
    const Matrix3 turn = random.rotation();
    for (Index k = 0; k < 10; ++k) close(random, d, i + k, j + k, turn, true);
  }
  const RobustSolution solution = solve_auto(d, true);
  const double off = mean_error(solution.rotations, d.truth);
  CHECK(off < 3.0 * error_of_right_ones(d) + 0.02);  // the first node hangs by a few edges
  Index bent = 0, missed = 0;
  for (std::size_t k = 0; k < d.is_wrong.size(); ++k) {
    const bool outlier = is_outlier(solution.verdicts.edges[k]);
    bent += outlier && d.is_odometry[k];
    missed += !outlier && d.is_wrong[k];
  }
  CHECK(bent <= 1);
  CHECK(missed <= 1);
  // Nothing was trusted.
  CHECK(std::count(solution.verdicts.edges.begin(), solution.verdicts.edges.end(),
                   EdgeVerdict::trusted) == 0);
  // All edges alike, it is the other way round: closures that agree win.
  CHECK(mean_error(solve_auto(d, false).rotations, d.truth) > 2.0 * off);
}

TEST_CASE("a step of odometry that many closures contradict is wrong for all that") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 400;
  Drive d = drive(random, n);
  constexpr std::size_t slip = 200;
  d.measurements[slip].i_from_j *= exp_so3({0.0, 0.7, 0.0});
  d.is_wrong[slip] = true;
  for (int k = 0; k < 60; ++k) {
    const Index i = random.below(n / 2 - 5), j = n / 2 + 5 + random.below(n / 2 - 5);
    close(random, d, i, j, k % 5 == 0 ? random.rotation() : Matrix3::Identity(), k % 5 == 0);
  }
  const RobustSolution solution = solve_auto(d, true);
  const double off = mean_error(solution.rotations, d.truth);
  CHECK(off < 2.0 * error_of_right_ones(d) + 0.02);
  // Between the ends of closures nothing tells one step from the next.
  Index accused = 0, elsewhere = 0;
  for (std::size_t k = 0; k < n - 1; ++k) {
    const bool near = k + 20 > slip && k < slip + 20;
    (near ? accused : elsewhere) += is_outlier(solution.verdicts.edges[k]);
  }
  CHECK(accused == 1);
  CHECK(elsewhere == 0);
}

TEST_CASE("mishaps: closures of one place are one, steps are two, edges near by count singly") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 400;
  Drive d = drive(random, n);
  close(random, d, 0, n - 1, Matrix3::Identity(), false);  // so that no step is a bridge
  const Matrix3 turn = random.rotation();
  for (Index k = 0; k < 10; ++k) close(random, d, 50 + k, 300 + k, turn, true);  // a run
  for (Index k = 0; k < 6; ++k) {                                                // six places
    close(random, d, 100 + 20 * k, 250 + 20 * k, random.rotation(), true);
  }
  for (Index k = 0; k < 3; ++k) close(random, d, 30 * k, 30 * k + 5, turn, true);  // near by
  std::swap(d.measurements.back().i, d.measurements.back().j);
  d.measurements.back().i_from_j.transposeInPlace();
  for (const std::size_t step : {120u, 130u}) d.measurements[step].i_from_j *= turn;
  const MeasurementGraph graph = d.graph();
  const CheckedPart part(graph, {});
  REQUIRE(part.graph().num_edges() == graph.num_edges());
  const EdgeUnits units = edge_units(graph, {}, WeightKind::precision);
  const Stopwatch watch;
  RobustRun run(graph, {}, part.series_of_part(), units, watch);
  constexpr double noise = 2.0 * step_noise;
  const double found = mishaps(run, graph, d.truth, d.is_odometry, noise);
  CHECK(found == doctest::Approx(1.9 + 6.0 + 3.0 + 2.0 * 2.0));
  // Where steps are wrong as often as anything else, they are nothing special.
  for (std::size_t step = 0; step < n - 1; step += 20) d.measurements[step].i_from_j *= turn;
  const MeasurementGraph slippery = d.graph();
  RobustRun other(slippery, {}, part.series_of_part(), units, watch);
  const double more = mishaps(other, slippery, d.truth, d.is_odometry, noise);
  CHECK(more == doctest::Approx(1.9 + 6.0 + 3.0 + 21.0));  // 120 is one of both
}

TEST_CASE("favoured odometry costs six times as much to give up, and the same within its noise") {
  const RobustLoss loss{Loss::tls, 0.1};
  std::vector<double> precision;
  favour({true, false}, precision);
  const double step = precision[0], closure = precision[1];
  CHECK(robust_cost(loss, 1e-4, step) == doctest::Approx(robust_cost(loss, 1e-4, closure)));
  CHECK(robust_cost(loss, 1.0, step) == doctest::Approx(6.0 * robust_cost(loss, 1.0, closure)));
}

TEST_CASE("closures that agree with one another: all pairs, by the cycle that they make") {
  Random random;
  INFO(random.replay());
  constexpr Index n = 120;
  Drive d = drive(random, n);
  for (int k = 0; k < 60; ++k) {
    const Index i = random.below(n - 10), j = i + 5 + random.below(n - i - 5);
    close(random, d, i, j, k % 3 == 0 ? random.rotation() : Matrix3::Identity(), k % 3 == 0);
  }
  for (std::size_t k = n - 1; k < d.measurements.size(); k += 2) {  // some the other way round
    RelativeRotation& m = d.measurements[k];
    std::swap(m.i, m.j);
    m.i_from_j.transposeInPlace();
  }
  const MeasurementGraph graph = d.graph();
  const std::vector<double> precision = edge_units(graph, {}, WeightKind::precision).precision;
  constexpr double noise = step_noise * 1.7;
  const std::vector<bool> chosen = agreeing_closures(graph, d.is_odometry, precision, noise);

  Rotations along(n, Matrix3::Identity());
  for (Index i = 0; i + 1 < n; ++i) along[i + 1] = along[i] * d.measurements[i].i_from_j;
  std::vector<bool> expected = d.is_odometry;
  for (std::size_t a = n - 1; a < d.measurements.size(); ++a) {
    for (std::size_t b = a + 1; b < d.measurements.size(); ++b) {
      const auto turn = [&](const RelativeRotation& m) {
        const Matrix3 there = along[m.i] * m.i_from_j * along[m.j].transpose();
        return Matrix3(m.i < m.j ? there : there.transpose());
      };
      const RelativeRotation &A = d.measurements[a], &B = d.measurements[b];
      const double steps = static_cast<double>(std::abs(std::min(A.i, A.j) - std::min(B.i, B.j)) +
                                               std::abs(std::max(A.i, A.j) - std::max(B.i, B.j)));
      const double variance =
          (1.0 / precision[a] + 1.0 / precision[b] + steps / precision[0]) * noise * noise;
      if (variance > 0.04) continue;
      if (0.5 * (turn(A) - turn(B)).squaredNorm() > 9.0 * variance) continue;
      expected[a] = expected[b] = true;
    }
  }
  CHECK(chosen == expected);
  Index right = 0, wrong = 0;
  for (std::size_t k = n - 1; k < chosen.size(); ++k) (d.is_wrong[k] ? wrong : right) += chosen[k];
  CHECK(right >= 36);  // of 40
  CHECK(wrong <= 6);   // of 20
}

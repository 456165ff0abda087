// A graph some of whose edges are wrong: which they are, the graph without them, and how well each
// rotation is then known. docs/robust.md tells what the verdicts mean, and what is proved.

#include <cmath>
#include <cstdio>
#include <vector>

#include <rotavg/rotavg.hpp>

int main() {
  using rotavg::Index;
  using rotavg::Matrix3;
  constexpr int n = 30;
  const auto turn = [](double a, double b, double c) { return rotavg::exp_so3({a, b, c}); };
  // R_i = world_from_i, and every pair less than four apart, off by a hundredth of a radian or so.
  std::vector<Matrix3> truth;
  for (int i = 0; i < n; ++i) truth.push_back(turn(0.02 * i, std::sin(i), 0.1 * i));
  std::vector<rotavg::RelativeRotation> measured;
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n && j < i + 4; ++j) {
      const double a = 0.01 * std::sin(7 * i + j), b = 0.01 * std::cos(3 * i + 5 * j);
      measured.push_back({i, j, truth[i].transpose() * truth[j] * turn(a, b, a * b)});
    }
  }
  for (const int k : {5, 20, 40, 60}) measured[k].i_from_j = turn(k, 1, -k);  // wrong
  const rotavg::MeasurementGraph graph(measured);

  const rotavg::RobustSolution robust = rotavg::solve_robust(graph);
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (rotavg::is_outlier(robust.verdicts.edges[k])) {
      std::printf("wrong: %d to %d\n", int(measured[k].i), int(measured[k].j));
    }
  }

  // Least squares on what is left, from there on: a problem with a proof and covariances.
  const rotavg::MeasurementGraph right = rotavg::without_outliers(graph, robust.verdicts);
  const rotavg::Solution solution = rotavg::solve(right, {}, robust.rotations);
  rotavg::CovarianceOptions noise;
  noise.noise_variance = robust.noise * robust.noise / 3;  // per axis
  const rotavg::Covariances known =
      rotavg::covariances(right, solution.rotations, {{0, n / 2}, {0, n - 1}}, noise);
  std::printf("noise %.2g rad; off by %.2g rad at node %d, and %.2g at node %d\n", robust.noise,
              std::sqrt(known.pairs[0].trace()), n / 2, std::sqrt(known.pairs[1].trace()), n - 1);
  const bool proved = solution.certificate.verdict == rotavg::Verdict::proved;
  return proved && graph.num_edges() - right.num_edges() == 4 ? 0 : 1;
}

// Fixed rotations, gravity and a calibrated rig, from C++: docs/priors.md tells what each means.

#include <cstdio>

#include <rotavg/rotavg.hpp>

int main() {
  using rotavg::Matrix3;
  const auto turn = [](double x, double y, double z) { return rotavg::exp_so3({x, y, z}); };

  // A rig of two cameras at three places: nodes 10, 11 at the first, 20, 21 at the second, …
  const Matrix3 left = Matrix3::Identity(), right = turn(0, 0.5, 0);
  const rotavg::MeasurementGraph graph({{10, 20, turn(0, 0.30, 0.01)},  // i, j, R_ij
                                        {20, 30, turn(0, 0.31, 0)},
                                        {10, 30, turn(0.01, 0.60, 0)},
                                        {11, 21, turn(0, 0.29, 0)},
                                        {21, 31, turn(0, 0.30, -0.01)}});
  rotavg::Priors priors;
  for (const int place : {1, 2, 3}) {
    priors.rigs.push_back({10 * place, place, left});  // node, frame, frame_from_node
    priors.rigs.push_back({10 * place + 1, place, right});
  }
  priors.fixed = {{10, Matrix3::Identity()}};       // node, world_from_node
  priors.gravity = {{30, {0.02, 1.0, 0.0}, 10.0}};  // node, down in its frame, weight

  const rotavg::Solution solution = rotavg::solve(graph, priors);
  std::printf("objective %.6g, relative gap %.1g\n", solution.objective,
              solution.certificate.relative_gap);
  for (rotavg::Index k = 0; k < graph.num_nodes(); ++k) {
    const rotavg::Vector3 w = rotavg::log_so3(solution.rotations[k]);
    std::printf("node %lld: % .4f % .4f % .4f\n", static_cast<long long>(graph.nodes()[k]), w.x(),
                w.y(), w.z());
  }
  return solution.certificate.verdict == rotavg::Verdict::proved ? 0 : 1;
}

// Four views in a ring and one diagonal, measured with some error: find the rotations, and how sure
// the answer is.

#include <cstdio>

#include <rotavg/rotavg.hpp>

int main() {
  const auto turn = [](double degrees) {
    return rotavg::exp_so3(rotavg::Vector3::UnitZ() * degrees * 3.14159265358979 / 180.0);
  };
  // {i, j, R_ij, weight}: R_i R_ij ~ R_j with R_i = world_from_i.
  const rotavg::MeasurementGraph graph({{10, 20, turn(90.5), 1.0},
                                        {20, 30, turn(89.0), 1.0},
                                        {30, 40, turn(91.0), 1.0},
                                        {40, 10, turn(90.0), 1.0},
                                        {10, 30, turn(180.0), 0.5}});
  const rotavg::Solution solution = rotavg::solve(graph);

  for (rotavg::Index k = 0; k < graph.num_nodes(); ++k) {
    const rotavg::Vector3 w = rotavg::log_so3(solution.rotations[k]) * 180.0 / 3.14159265358979;
    std::printf("node %lld: %8.3f deg about z\n", static_cast<long long>(graph.nodes()[k]), w.z());
  }
  const rotavg::Certificate& certificate = solution.certificate;
  const bool proved = certificate.verdict == rotavg::Verdict::proved;
  std::printf("objective %.6g, %s (gap at most %.1e)\n", solution.objective,
              proved ? "proved globally optimal" : "not proved", certificate.gap);
  return proved ? 0 : 1;
}

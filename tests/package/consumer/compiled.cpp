#include <cmath>
#include <cstdio>
#include <vector>

#include <rotavg/rotavg.hpp>

rotavg::Matrix3 quarter_turn();  // other.cpp, which includes a part of the library

/// A square whose four quarter turns about z close the loop: node k is turned by k quarters.
int main() {
  std::vector<rotavg::RelativeRotation> measurements;
  for (int k = 0; k < 4; ++k) measurements.push_back({k, (k + 1) % 4, quarter_turn()});
  const rotavg::MeasurementGraph graph(measurements);
  const rotavg::Solution solution = rotavg::solve(graph);

  rotavg::Matrix3 expected = rotavg::Matrix3::Identity();
  for (const rotavg::Matrix3& R : solution.rotations) {
    if ((R - expected).norm() > 1e-12) {
      std::puts("a rotation is wrong");
      return 1;
    }
    expected = expected * quarter_turn();
  }
  if (solution.certificate.verdict != rotavg::Verdict::proved) {
    std::puts("the optimum was not proved");
    return 1;
  }
  return 0;
}

#include <cmath>
#include <cstdio>
#include <vector>

#include <rotavg/init/shortest_path.hpp>
#include <rotavg/solve/newton.hpp>  // with SuiteSparse's order of elimination

rotavg::Matrix3 quarter_turn();  // other.cpp, which includes a part of the library

/// A square whose four quarter turns about z close the loop: node k is turned by k quarters.
int main() {
  std::vector<rotavg::RelativeRotation> measurements;
  for (int k = 0; k < 4; ++k) measurements.push_back({k, (k + 1) % 4, quarter_turn()});
  const rotavg::MeasurementGraph graph(measurements);
  const rotavg::IterationResult result = rotavg::newton(graph, rotavg::shortest_path_init(graph));

  rotavg::Matrix3 expected = rotavg::Matrix3::Identity();
  for (const rotavg::Matrix3& R : result.rotations) {
    if ((R - expected).norm() > 1e-12) {
      std::puts("a rotation is wrong");
      return 1;
    }
    expected = expected * quarter_turn();
  }
  return 0;
}

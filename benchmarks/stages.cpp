// Where the time goes, in CPU milliseconds of one thread, medians of many runs in one process: the
// initial value, the solution, the proof, all together, and the proof's one Cholesky factorisation
// alone. Run by benchmarks/stages.py: `./dev bench stages GRAPH...`.

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <vector>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/rotavg.hpp>

namespace {

double cpu_ms() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Lines `i j qx qy qz qw weight`.
rotavg::MeasurementGraph read(const char* path) {
  std::ifstream file(path);
  std::vector<rotavg::RelativeRotation> measurements;
  rotavg::RelativeRotation m;
  double x, y, z, w;
  while (file >> m.i >> m.j >> x >> y >> z >> w >> m.weight) {
    m.i_from_j = rotavg::Quaternion(w, x, y, z).toRotationMatrix();
    measurements.push_back(m);
  }
  return rotavg::MeasurementGraph(measurements);
}

/// One numeric factorisation of S at R, with a node of the first component removed.
double factorization_ms(const rotavg::MeasurementGraph& graph, const rotavg::Rotations& R,
                        int runs) {
  const rotavg::Components components = rotavg::connected_components(graph);
  std::vector<rotavg::Elimination> eliminations = rotavg::grounded_eliminations(graph, components);
  const rotavg::ResidualQuaternions residuals(graph, rotavg::to_quaternions(R), 1);
  const rotavg::NodeSums sums(residuals);
  const auto blocks = rotavg::CertificateMatrix(sums, components, 0).blocks(eliminations[0]);
  const auto symbolic = eliminations[0].symbolic();
  std::vector<double> times;
  for (int run = 0; run < runs; ++run) {
    const double before = cpu_ms();
    rotavg::BlockCholesky<3> cholesky(symbolic);  // with its memory, as in a solution
    cholesky.factorize(blocks);
    times.push_back(cpu_ms() - before);
  }
  return median(times);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: stages FILE RUNS\n";
    return 2;
  }
  const rotavg::MeasurementGraph graph = read(argv[1]);
  const int runs = std::atoi(argv[2]);
  rotavg::SolveOptions options;
  options.iteration.num_threads = 1;
  std::vector<double> init, solve, certify, total;
  rotavg::Solution solution;
  for (int run = 0; run < runs; ++run) {
    const double before = cpu_ms();
    solution = rotavg::solve(graph, options);
    total.push_back(cpu_ms() - before);
    init.push_back(1e3 * solution.timings.init);  // of the wall, but with one thread they are alike
    solve.push_back(1e3 * solution.timings.solve);
    certify.push_back(1e3 * solution.timings.certify);
  }
  for (const auto& times : {init, solve, certify, total}) std::cout << median(times) << ' ';
  std::cout << factorization_ms(graph, solution.rotations, runs) << '\n';
}

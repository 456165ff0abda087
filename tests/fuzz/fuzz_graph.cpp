// Coverage-guided fuzzing of measurement graphs and of what solves them, by libFuzzer. The bytes
// are read one by one: options, then edges, whose numbers are odd ones or as their bytes have them.
// A graph is refused by std::invalid_argument, or else solved to rotations, with a bound that
// holds.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <vector>

#include <rotavg/init/shortest_path.hpp>
#include <rotavg/rotavg.hpp>

namespace {

void expect(bool holds) {
  if (!holds) std::abort();
}

class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : at_(data), end_(data + size) {}
  bool empty() const { return at_ == end_; }
  unsigned byte() { return empty() ? 0 : *at_++; }
  unsigned below(unsigned count) { return byte() % count; }
  /// Of moderate size mostly; sometimes odd, sometimes whatever eight bytes say.
  double number() {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const double odd[] = {0.0,   -0.0,   infinity, -infinity, std::nan(""), 1e-320,
                          1e308, 1e-100, 1e100,    -1.0,      1e-9,         3.141592653589793};
    const unsigned kind = byte();
    if (kind < 12) return odd[kind];
    if (kind < 16) {
      std::uint64_t bits = 0;
      for (int k = 0; k < 8; ++k) bits = bits << 8U | byte();
      double value = 0.0;
      std::memcpy(&value, &bits, sizeof value);
      return value;
    }
    return (static_cast<double>(kind) - 136.0 + byte() / 256.0) / 40.0;
  }
  double weight() {
    const unsigned kind = byte();
    if (kind < 8) return number();
    return kind < 200 ? kind / 100.0 : std::pow(10.0, (kind - 228.0) * 3.5);
  }

 private:
  const std::uint8_t* at_;
  const std::uint8_t* end_;
};

void check(const rotavg::Rotations& rotations, double objective) {
  expect(std::isfinite(objective) && objective >= 0.0);
  for (const rotavg::Matrix3& R : rotations) {
    expect(rotavg::orthogonality_error(R) < 1e-9 && rotavg::determinant(R) > 0.0);
  }
}

rotavg::Priors read_priors(Bytes& bytes, unsigned num_nodes) {
  rotavg::Priors priors;
  for (unsigned count = bytes.below(4); count > 0; --count) {
    const auto node = static_cast<rotavg::NodeId>(bytes.below(num_nodes + 1));
    const rotavg::Vector3 v(bytes.number(), bytes.number(), bytes.number());
    const bool small = v.norm() < 10.0;
    const rotavg::Matrix3 R = rotavg::exp_so3(small ? v : rotavg::Vector3(0.1, 0.2, 0.3));
    switch (bytes.below(4)) {
      case 0:
        priors.fixed.push_back({node, R});
        break;
      case 1:
        priors.absolute.push_back({node, R, bytes.weight()});
        break;
      case 2:
        priors.gravity.push_back({node, v, bytes.weight()});
        break;
      default:
        priors.rigs.push_back({node, bytes.below(3), R});
    }
  }
  return priors;
}

void solve(Bytes& bytes) {
  using namespace rotavg;
  const unsigned num_nodes = 1 + bytes.below(8);
  SolveOptions options;
  options.method = static_cast<Method>(bytes.below(6));
  options.init = static_cast<Initialization>(bytes.below(7));
  options.accelerate = bytes.below(2) == 1;
  options.iteration.num_threads = static_cast<int>(1 + bytes.below(3));
  options.iteration.max_iterations = static_cast<Index>(bytes.below(40));
  options.max_rank = static_cast<int>(bytes.below(8));
  if (bytes.below(4) == 0) options.certificate.max_factorization_flops = 0.0;
  const unsigned how = bytes.below(6);
  const Priors priors = how == 1 || how == 2 ? read_priors(bytes, num_nodes) : Priors{};

  std::vector<RelativeRotation> matrices;
  std::vector<RelativeQuaternion> quaternions;
  const bool as_matrices = bytes.below(2) == 1;
  while (!bytes.empty() && matrices.size() + quaternions.size() < 40) {
    const NodeId i = bytes.below(num_nodes), j = bytes.below(num_nodes);
    if (as_matrices && bytes.below(8) == 0) {
      Matrix3 M;
      for (int k = 0; k < 9; ++k) M(k) = bytes.number();
      matrices.push_back({i, j, M, bytes.weight()});
    } else {
      const double w = bytes.number(), x = bytes.number(), y = bytes.number(), z = bytes.number();
      quaternions.push_back({i, j, {w, x, y, z}, bytes.weight()});
    }
  }
  if (as_matrices) {
    for (const RelativeQuaternion& q : quaternions) {
      const Matrix3 R = q.i_from_j.normalized().toRotationMatrix();
      matrices.push_back({q.i, q.j, R, q.weight});
    }
  }
  std::vector<NodeId> nodes;
  for (unsigned k = 0; k < num_nodes; ++k) nodes.push_back(k);
  const MeasurementGraph graph =
      as_matrices ? MeasurementGraph(matrices)
                  : MeasurementGraph(
                        quaternions.size(), [&](std::size_t k) { return quaternions[k]; }, nodes);
  if (how >= 2 && how <= 3) {
    RobustOptions robust;
    robust.loss = static_cast<Loss>(bytes.below(8));
    const RobustSolution solution = how == 2 ? solve_robust(graph, priors, options, robust)
                                             : solve_robust(graph, options, robust);
    return check(solution.rotations, solution.objective);
  }
  if (how == 1) {
    const Solution solution = rotavg::solve(graph, priors, options);
    return check(solution.rotations, solution.objective);
  }
  const Solution solution = rotavg::solve(graph, options);
  check(solution.rotations, solution.objective);
  // No rotations are below the bound that the certificate of any others gives.
  const Rotations others[] = {solution.rotations, shortest_path_init(graph),
                              Rotations(solution.rotations.size(), Matrix3::Identity())};
  for (const Rotations& R : others) {
    const Certificate certificate = certify(graph, R, options.certificate);
    expect(certificate.gap >= 0.0);
    const double bound = objective(graph, R) - certificate.gap;
    const double rounding = 1e-12 * graph.total_weight();
    for (const Rotations& Q : others) expect(!(bound > objective(graph, Q) + rounding));
  }
  if (how == 4) covariances(graph, solution.rotations, {{0, graph.num_nodes() - 1}});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  try {
    solve(bytes);
  } catch (const std::invalid_argument&) {
  }
  return 0;
}

// A program that uses most of the library: templates and inline functions are compiled, and warned
// of, only where they are used. Compiled by any compiler, it comes to the same end.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <random>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <rotavg/io/g2o.hpp>
#include <rotavg/io/g2o_write.hpp>
#include <rotavg/io/text.hpp>
#include <rotavg/rotavg.hpp>

namespace {

using rotavg::Index;
using rotavg::Matrix3;

int failures = 0;

void expect(bool holds, const char* what) {
  if (holds) return;
  ++failures;
  std::printf("failed: %s\n", what);
}

/// A ring with chords, 2 and 7 nodes wide, and a triangle apart from it.
/// @param wrong every how many edges a chord is a random rotation; 0: none is
std::vector<rotavg::RelativeRotation> measure(int wrong) {
  constexpr int ring = 40;
  std::mt19937_64 generator(7);
  std::vector<Matrix3> truth;
  for (int k = 0; k < ring + 3; ++k) truth.push_back(rotavg::random_rotation(generator));
  std::vector<rotavg::RelativeRotation> measurements;
  const auto join = [&](int i, int j, bool is_wrong) {
    const double angle = 0.1 * (rotavg::random_unit(generator) - 0.5);
    const rotavg::Vector3 axis = rotavg::random_rotation(generator).col(0);
    const Matrix3& R_i = truth[static_cast<std::size_t>(i)];
    const Matrix3& R_j = truth[static_cast<std::size_t>(j)];
    const Matrix3 R_ij = is_wrong ? rotavg::random_rotation(generator)
                                  : Matrix3(R_i.transpose() * R_j * rotavg::exp_so3(angle * axis));
    measurements.push_back({100 + i, 100 + j, R_ij, 1.0 + 0.1 * (i % 3)});
  };
  for (const int width : {1, 2, 3, 7}) {
    for (int i = 0; i < ring; ++i) {
      join(i, (i + width) % ring, wrong > 0 && width > 1 && i % wrong == 0);
    }
  }
  for (int i = 0; i < 3; ++i) join(ring + i, ring + (i + 1) % 3, false);
  return measurements;
}

bool is_close(double a, double b) { return std::abs(a - b) <= 1e-6 * std::abs(b); }

/// Every method, start, stopping rule and variant ends at the same proved optimum.
void solve_in_all_ways(const rotavg::MeasurementGraph& graph, double optimum) {
  const auto meets = [&](const rotavg::SolveOptions& options, const char* what) {
    const rotavg::Solution solution = rotavg::solve(graph, options);
    expect(rotavg::is_converged(solution.status), what);
    expect(is_close(solution.objective, optimum), what);
    expect(solution.certificate.verdict == rotavg::Verdict::proved, what);
  };
  rotavg::SolveOptions options;
  using rotavg::Method;
  for (const Method method : {Method::bcd, Method::sum, Method::newton, Method::staircase}) {
    options.method = method;
    for (const bool accelerate : {false, true}) {
      options.accelerate = accelerate;
      meets(options, "a method");
    }
  }
  options = {};
  using rotavg::Initialization;
  for (const Initialization init :
       {Initialization::shortest_path, Initialization::spanning_tree,
        Initialization::maximum_spanning_tree, Initialization::multilevel, Initialization::chordal,
        Initialization::quaternion, Initialization::random}) {
    options.init = init;
    meets(options, "an initial value");
  }
  options = {};
  options.method = Method::sum;
  options.mu = rotavg::MuRule::min_eigenvalue;
  meets(options, "SUM as printed");
  options.iteration.stop = rotavg::StopRule::step;
  options.iteration.tolerance = 1e-10;
  options.iteration.num_threads = 2;
  Index calls = 0;
  options.iteration.callback = [&](const rotavg::Progress& progress) {
    calls += progress.objective >= 0.0;
    return true;
  };
  options.iteration.keep_going = [] { return true; };
  meets(options, "the paper's stopping rule");
  expect(calls > 1, "the callback is called");
  options = {};
  options.method = Method::bcdsr;
  options.iteration.tolerance = 1e-6;
  meets(options, "the semidefinite relaxation");
}

/// Certificates by eigenvalues where no factorisation is allowed; refused input.
void certify(const rotavg::MeasurementGraph& graph, const rotavg::Solution& solution) {
  rotavg::CertificateOptions options;
  expect(rotavg::certify(graph, solution.rotations, options).gap < 1e-6, "the gap");
  options.max_factorization_flops = 0.0;
  expect(rotavg::certify(graph, solution.rotations, options).verdict == rotavg::Verdict::proved,
         "a proof from a random start");
  options.failure_probability = 0.0;
  expect(rotavg::certify(graph, solution.rotations, options).verdict == rotavg::Verdict::estimated,
         "an estimated certificate");
  bool thrown = false;
  try {
    rotavg::certify(graph, rotavg::Rotations{Matrix3::Identity()});
  } catch (const std::invalid_argument&) {
    thrown = true;
  }
  expect(thrown, "too few rotations are refused");
}

/// A warm start, the objective and its gradient there, and what the graph itself tells.
void look_around(const rotavg::MeasurementGraph& graph, const rotavg::Solution& solution) {
  const rotavg::Rotations start =
      rotavg::warm_start(graph, graph, solution.rotations, solution.components);
  expect(rotavg::solve(graph, {}, start).iterations <= 3, "a warm start");
  expect(is_close(rotavg::objective(graph, solution.rotations), solution.objective), "objective");
  double largest = 0.0;
  for (const auto& g : rotavg::gradient(graph, solution.rotations)) {
    largest = std::max(largest, g.norm());
  }
  expect(largest < 1e-6, "the gradient");
  const rotavg::BreadthFirstForest forest = rotavg::breadth_first_forest(graph);
  expect(rotavg::fundamental_cycle_length(graph, forest, 1) >= 1, "a cycle");
  for (const bool is_bridge : rotavg::bridges(graph)) expect(!is_bridge, "no bridge");
  expect(rotavg::algebraic_connectivity(graph, solution.components, 0) > 0.1, "connectivity");
  const Matrix3 M = solution.rotations[1] * 2.0;
  expect((rotavg::loso(M) - rotavg::loso_fast(M)).norm() < 1e-12, "Algorithm 1");
  expect(rotavg::angle_between(M / 2.0, solution.rotations[1]) < 1e-12, "an angle");
}

/// Covariances of both noise models.
void tell_uncertainty(const rotavg::MeasurementGraph& graph, const rotavg::Rotations& R) {
  const std::vector<rotavg::NodePair> pairs = {{0, 1}, {0, 20}, {5, 30}, {40, 42}};
  rotavg::CovarianceOptions options;
  const auto all_positive = [&](const rotavg::Covariances& covariances) {
    bool positive = covariances.status == rotavg::CovarianceStatus::computed;
    for (const Matrix3& C : covariances.pairs) positive = positive && C.trace() > 0.0;
    return positive;
  };
  expect(all_positive(rotavg::covariances(graph, R, pairs, options)), "covariances");
  options.information.assign(graph.edges().size(), rotavg::Vector3(1.0, 2.0, 3.0).asDiagonal());
  const rotavg::IterationResult refined = rotavg::refine_anisotropic(graph, options.information, R);
  expect(rotavg::is_converged(refined.status), "anisotropic noise");
  expect(all_positive(rotavg::covariances(graph, refined.rotations, pairs, options)),
         "anisotropic covariances");
}

/// All kinds of priors, true ones: a proof as without them.
void use_priors(const rotavg::MeasurementGraph& graph, const rotavg::Rotations& R) {
  rotavg::Priors priors;
  priors.fixed.push_back({graph.nodes()[3], R[3]});
  priors.absolute.push_back({graph.nodes()[9], R[9], 2.0});
  priors.gravity.push_back({graph.nodes()[20], R[20].transpose() * priors.down, 1.0});
  for (const std::size_t k : {std::size_t{30}, std::size_t{31}}) {
    priors.rigs.push_back({graph.nodes()[k], 1, R[30].transpose() * R[k]});
  }
  const rotavg::GroundedGraph problem(graph, priors);
  const rotavg::Solution solution = rotavg::solve(problem);
  expect(solution.certificate.verdict == rotavg::Verdict::proved, "a proof with priors");
  expect(rotavg::angle_between(solution.rotations[3], R[3]) < 1e-9, "a fixed node");
  expect(rotavg::certify(problem, solution.rotations).gap < 1e-6, "the gap with priors");
  expect(rotavg::marginal_covariances(problem, solution.rotations).status ==
             rotavg::CovarianceStatus::computed,
         "covariances with priors");
  const rotavg::RobustSolution robust = rotavg::solve_robust(graph, priors);
  expect(rotavg::angle_between(robust.rotations[3], R[3]) < 1e-9, "robust with priors");
}

/// Every loss sees through some wrong chords.
void see_through_outliers(const rotavg::Solution& clean) {
  const rotavg::MeasurementGraph graph(measure(8));
  using rotavg::Loss;
  for (const Loss kind : {Loss::automatic, Loss::l2, Loss::huber, Loss::l1, Loss::l_half,
                          Loss::cauchy, Loss::geman_mcclure, Loss::tls}) {
    rotavg::RobustOptions robust;
    robust.loss = kind;
    if (kind == Loss::tls) robust.cycle_threshold = 0.5;
    const rotavg::RobustSolution solution = rotavg::solve_robust(graph, {}, robust);
    expect(solution.rotations.size() == clean.rotations.size(), "all nodes have rotations");
    if (kind == Loss::l2) continue;
    double largest = 0.0;
    for (std::size_t k = 0; k < 40; ++k) {
      largest = std::max(largest, rotavg::angle_between(solution.rotations[k], clean.rotations[k]));
    }
    expect(largest < 0.2, "a robust loss");
  }
  int refuted = 0;
  for (const auto& evidence : rotavg::cycle_evidence(graph, 0.5)) refuted += evidence.refuted();
  expect(refuted > 0, "the cycle check");
}

/// A graph and its solution come back from every format; what is no graph is refused.
void read_and_write(const rotavg::MeasurementGraph& graph, const rotavg::Solution& solution) {
  namespace io = rotavg::io;
  const auto objective_of = [&](const io::GraphFile& file) {
    return rotavg::objective(file.graph(), solution.rotations);
  };
  std::istringstream text(io::to_text(graph)), csv(io::to_csv(graph)), g2o(io::to_g2o(graph));
  expect(is_close(objective_of(io::read_text(text)), solution.objective), "text");
  expect(is_close(objective_of(io::read_csv(csv)), solution.objective), "CSV");
  const io::PoseFile file = io::read_g2o(g2o);
  expect(is_close(objective_of(file), solution.objective), "g2o");
  std::istringstream back(io::to_g2o(file, solution.rotations, solution.components));
  const io::PoseFile solved = io::read_g2o(back);
  rotavg::Rotations R;
  for (const io::Vertex& vertex : solved.vertices) R.push_back(vertex.world_from_node);
  expect(is_close(rotavg::objective(graph, R), solution.objective), "a solution in g2o");
  std::istringstream known(io::to_text(graph.nodes(), solution.rotations));
  const auto fixed = io::of_graph(io::read_text_rotations(known), file);
  expect(fixed.size() == solution.rotations.size(), "rotations");
  std::istringstream gravity("100 0 1 0\n");
  expect(io::of_graph(io::read_gravity(gravity), file).size() == 1, "gravity");
  std::istringstream wrong("0 1 2\n");
  bool thrown = false;
  try {
    io::read_text(wrong);
  } catch (const io::FormatError& error) {
    thrown = error.line() == 1;
  }
  expect(thrown, "a bad file is refused");
}

}  // namespace

int main() {
  const rotavg::MeasurementGraph graph(measure(0));
  const rotavg::Solution solution = rotavg::solve(graph);
  expect(solution.certificate.verdict == rotavg::Verdict::proved, "the proof");
  solve_in_all_ways(graph, solution.objective);
  certify(graph, solution);
  read_and_write(graph, solution);
  look_around(graph, solution);
  tell_uncertainty(graph, solution.rotations);
  use_priors(graph, solution.rotations);
  see_through_outliers(solution);
  return failures == 0 ? 0 : 1;
}

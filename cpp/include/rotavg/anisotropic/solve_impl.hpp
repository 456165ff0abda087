#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/bcd.hpp>
#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/newton.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/sum.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/reduction/reduced_graph.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// One call of solve(): from a start to a certified answer, and a second one where that is refuted.
class AnisotropicRun {
 public:
  AnisotropicRun(const AnisotropicGraph& graph, const SolveOptions& options)
      : graph_(graph),
        options_(options),
        components_(connected_components(graph.scalar())),
        eliminations_(grounded_eliminations(graph.scalar(), components_,
                                            resolve_num_threads(options.iteration.num_threads))) {}

  Solution operator()(std::optional<Rotations> start) {
    Solution solution;
    const Rotations R =
        start ? checked_rotations(graph_.scalar(), *std::move(start)) : initial_value(solution);
    solution.timings.init = watch_.seconds();
    descend(R, solution);
    const bool refuted = solution.certificate.shortfall == Shortfall::negative;
    if (is_scalar_first() && refuted && is_converged(solution.status) && may_go_on(solution)) {
      try_chordal_start(solution);
    }
    return solution;
  }

 private:
  static constexpr double max_flops = 5e10;

  bool is_scalar_first() const {
    return options_.method == Method::automatic || options_.method == Method::staircase ||
           options_.method == Method::bcdsr;
  }
  double time_left() const { return options_.iteration.time_limit - watch_.seconds(); }
  bool may_go_on(const Solution& solution) const {
    return time_left() > 0.0 && solution.iterations < options_.iteration.max_iterations &&
           (!options_.iteration.keep_going || options_.iteration.keep_going());
  }
  IterationOptions limits(const Solution& before) const {
    IterationResult spent;
    spent.iterations = before.iterations;
    spent.seconds = watch_.seconds();
    return before.iterations > 0 ? remaining(options_.iteration, spent) : options_.iteration;
  }

  Rotations initial_value(Solution& solution) {
    if (!is_scalar_first()) {
      SolveRun run(graph_.scalar(), options_);
      return run.initial_value(options_.init, solution.init);
    }
    constexpr double rough_tolerance = 1e-4;
    SolveOptions rough = options_;
    if (options_.method == Method::automatic) rough.certify = false;
    rough.iteration.stop = StopRule::gradient;
    rough.iteration.tolerance = std::max(options_.iteration.tolerance, rough_tolerance);
    Solution scalar = rotavg::solve(graph_.scalar(), rough);
    solution.init = scalar.init;
    solution.iterations = scalar.iterations;
    solution.reason = "without covariances " + std::string(name_of(scalar.method)) + ", then ";
    return std::move(scalar.rotations);
  }

  /// To a stationary point, and certified.
  void descend(const Rotations& R, Solution& solution) {
    const double before = watch_.seconds();
    const int iterations = solution.iterations;
    static_cast<IterationResult&>(solution) = iterate(R, limits(solution), solution);
    solution.iterations += iterations;
    solution.components = components_;
    fix_gauge(components_, solution.rotations);
    solution.timings.solve += watch_.seconds() - before;
    solution.certificate = Certificate{};
    const bool interrupted = options_.iteration.keep_going && !options_.iteration.keep_going();
    if (!options_.certify || interrupted) return;
    const double solved = watch_.seconds();
    CertificateOptions certificate = options_.certificate;
    certificate.num_threads = options_.iteration.num_threads;
    certificate.keep_going = [this] {
      return time_left() > 0.0 &&
             (!options_.iteration.keep_going || options_.iteration.keep_going());
    };
    solution.certificate =
        rotavg::certify(graph_, solution.rotations, components_, eliminations_, certificate);
    solution.timings.certify += watch_.seconds() - solved;
  }

  IterationResult iterate(const Rotations& R, const IterationOptions& limits, Solution& solution) {
    solution.method = options_.method;
    switch (options_.method) {
      case Method::bcd:
        return bcd(graph_, R, limits);
      case Method::sum:
        return sum(graph_, R, limits, options_.mu);
      case Method::newton:
        return newton(graph_, R, eliminations_, limits);
      case Method::automatic:
      case Method::staircase:
      case Method::bcdsr:
        break;
    }
    constexpr int sweeps = 3;
    double flops = 0.0;
    for (Elimination& elimination : eliminations_) flops += elimination.flops(3, max_flops);
    std::ostringstream reason;
    reason.precision(2);
    if (flops > max_flops) {
      solution.method = Method::sum;
      reason << "sum on the covariances: the Hessian is too large to factor (" << flops
             << " operations)";
      solution.reason += reason.str();
      return sum(graph_, R, limits);
    }
    solution.method = Method::newton;
    reason << "newton on the covariances after " << sweeps << " sweeps of bcd";
    solution.reason += reason.str();
    IterationOptions first = limits;
    first.max_iterations = std::min(sweeps, limits.max_iterations);
    IterationResult result = bcd(graph_, R, first);
    if (result.status != Status::iteration_limit || limits.max_iterations <= sweeps) return result;
    const Rotations swept = result.rotations;
    append(result, newton(graph_, swept, eliminations_, remaining(limits, result)));
    return result;
  }

  void try_chordal_start(Solution& solution) {
    const double before = watch_.seconds();
    const auto R =
        chordal_init(graph_.scalar(), eliminations_, max_flops, options_.iteration.keep_going);
    if (!R) return;
    Solution second;
    second.iterations = solution.iterations;
    second.timings = solution.timings;
    second.timings.init += watch_.seconds() - before;
    second.init = Initialization::chordal;
    descend(*R, second);
    const bool better = second.objective < solution.objective;
    const std::string reason = solution.reason + "; a second run, from the chordal start, did " +
                               (better ? "" : "no ") + "better";
    solution.timings = second.timings;
    if (better) solution = std::move(second);
    solution.reason = reason;
  }

  const AnisotropicGraph& graph_;
  const SolveOptions& options_;
  const Stopwatch watch_;
  const Components components_;
  std::vector<Elimination> eliminations_;
};

}  // namespace detail

ROTAVG_INLINE Solution solve(const AnisotropicGraph& graph, const SolveOptions& options,
                             std::optional<Rotations> start) {
  return detail::AnisotropicRun(graph, options)(std::move(start));
}

namespace detail {

/// What the edges cost whose two ends ride on one variable, whatever the others do.
inline double cost_of_held_edges(const GroundedGraph& problem,
                                 const std::vector<Matrix3>& precisions, const Rotations& R) {
  const auto& given = problem.given().edges();
  std::vector<bool> is_kept(given.size(), false);
  for (const Index k : problem.kept()) is_kept[k] = true;
  double sum = 0.0;
  for (std::size_t k = 0; k < given.size(); ++k) {
    if (is_kept[k]) continue;
    const Edge& e = given[k];
    const Matrix3 error = transposed_product(product(R[e.i], e.i_from_j()), R[e.j]);
    const Vector3 v = vector_part(to_quaternion(error).coeffs());
    sum += 4.0 * dot(v, product(precisions[k], v));
  }
  return sum;
}

}  // namespace detail

ROTAVG_INLINE Solution solve(const GroundedGraph& problem, const std::vector<Matrix3>& precisions,
                             const SolveOptions& options, const Rotations& start) {
  if (!problem.gravity().first.empty()) {
    throw std::invalid_argument("gravity is not possible with full covariances");
  }
  const auto& given = problem.given().edges();
  if (precisions.size() != given.size()) {
    throw std::invalid_argument("found " + std::to_string(precisions.size()) +
                                " precisions; expected " + std::to_string(given.size()) +
                                ", one for each edge");
  }
  std::vector<Matrix3> turned;  // into the frames of the variables
  for (const Index k : problem.kept()) {
    const Matrix3& C_j = problem.riding().variable_from_node[given[k].j];
    turned.push_back(product_transposed(C_j * precisions[k], C_j));
  }
  const auto& edges = problem.graph().edges();
  for (std::size_t k = turned.size(); k < edges.size(); ++k) {
    turned.push_back(edges[k].weight * Matrix3::Identity());
  }
  const AnisotropicGraph graph(problem.graph(), std::move(turned));
  const Rotations R = checked_rotations(problem.given(), start);
  Solution solution = solve(graph, options, problem.variables_from(R));
  solution.rotations = problem.nodes_from(solution.rotations);
  solution.components = components_of_nodes(problem.riding(), problem.components());
  const double held = detail::cost_of_held_edges(problem, precisions, solution.rotations);
  solution.objective += held;
  for (Progress& progress : solution.trace) progress.objective += held;
  return solution;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

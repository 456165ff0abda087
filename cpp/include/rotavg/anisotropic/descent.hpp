#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/bcd.hpp>
#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/newton.hpp>
#include <rotavg/anisotropic/sum.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/polish.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/stop_request.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg::detail {

/// From rotations down to a stationary point, by the method that is asked for or chosen, and its
/// certificate; as often as limits on time and iterations allow.
class AnisotropicDescent {
 public:
  /// @param graph must outlive this object
  AnisotropicDescent(const AnisotropicGraph& graph, const SolveOptions& options)
      : graph_(graph),
        options_(stop_.heeding(options)),
        components_(connected_components(graph.scalar())),
        eliminations_(grounded_eliminations(graph.scalar(), components_,
                                            resolve_num_threads(options.iteration.num_threads))),
        lower_bounds_(components_.nodes.size()) {
    check(options_);
  }

  /// Whether the descent is left to choose.
  bool chooses() const {
    return options_.method == Method::automatic || options_.method == Method::staircase ||
           options_.method == Method::bcdsr;
  }
  double time_left() const { return options_.iteration.time_limit - watch_.seconds(); }
  bool may_go_on(const Solution& solution) const {
    return !stop_.made() && time_left() > 0.0 &&
           solution.iterations < options_.iteration.max_iterations &&
           (!options_.iteration.keep_going || options_.iteration.keep_going());
  }
  /// What is left after what was done before.
  IterationOptions limits(const Solution& before) const {
    IterationResult spent;
    spent.iterations = before.iterations;
    spent.seconds = watch_.seconds();
    if (stop_.made()) spent.iterations = options_.iteration.max_iterations;
    return spent.iterations > 0 ? remaining(options_.iteration, spent) : options_.iteration;
  }

  bool is_refuted(const Solution& solution) const {
    return solution.certificate.shortfall == Shortfall::negative && is_converged(solution.status) &&
           may_go_on(solution);
  }
  /// Whether nothing is known of R, and a staircase would be quick, which leaves a bound at least.
  bool is_worth_a_climb(const Solution& solution) {
    if (solution.certificate.shortfall != Shortfall::undecided) return false;
    if (!is_converged(solution.status) || !may_go_on(solution)) return false;
    constexpr double quick = 1e9;
    double flops = 0.0;
    for (Elimination& elimination : eliminations_) flops += elimination.flops(3, quick);
    return flops <= quick;
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
    certify(solution);
  }

  void certify(Solution& solution) {
    const bool interrupted = options_.iteration.keep_going && !options_.iteration.keep_going();
    if (!options_.certify || interrupted) return;
    const double solved = watch_.seconds();
    CertificateOptions certificate = options_.certificate;
    certificate.num_threads = options_.iteration.num_threads;
    certificate.keep_going = [this] {
      return time_left() > 0.0 &&
             (!options_.iteration.keep_going || options_.iteration.keep_going());
    };
    solution.certificate = rotavg::certify(graph_, solution.rotations, components_, eliminations_,
                                           certificate, lower_bounds_);
    solution.timings.certify += watch_.seconds() - solved;
  }

  /// @returns whether more steps have made the gap smaller
  bool polish(Solution& solution) {
    const bool possible = is_leftover(solution.certificate) && is_converged(solution.status);
    if (!possible || !may_go_on(solution)) return false;
    const auto go_on = [this](const IterationOptions& options, Solution& next) {
      const double before = watch_.seconds();
      const Rotations R = next.rotations;
      append(next, newton(graph_, R, eliminations_, options));
      fix_gauge(components_, next.rotations);
      next.timings.solve += watch_.seconds() - before;
    };
    return rotavg::polish(solution, options_.certificate.tolerance, limits(solution),
                          /*by_sweeps=*/false, go_on, [this](Solution& next) { certify(next); });
  }

 protected:
  const AnisotropicGraph& graph_;
  const StopRequest stop_;
  const SolveOptions options_;
  const Stopwatch watch_;
  const Components components_;
  std::vector<Elimination> eliminations_;
  std::vector<LowerBound> lower_bounds_;  ///< on the optimum of every component

 private:
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
    solution.method = Method::newton;
    solution.reason +=
        "newton on the covariances after " + std::to_string(sweeps) + " sweeps of bcd";
    IterationOptions first = limits;
    first.max_iterations = std::min(sweeps, limits.max_iterations);
    IterationResult result = bcd(graph_, R, first);
    const bool is_done = result.status != Status::iteration_limit || stop_.made();
    if (is_done || limits.max_iterations <= sweeps) return result;
    const Rotations swept = result.rotations;
    append(result, newton(graph_, swept, eliminations_, remaining(limits, result)));
    return result;
  }
};

}  // namespace rotavg::detail

#pragma GCC diagnostic pop

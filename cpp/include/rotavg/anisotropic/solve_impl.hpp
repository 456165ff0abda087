#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/bcd.hpp>
#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/minorant.hpp>
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
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/polish.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/staircase.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// One call of solve(): from a start to a certified answer, and others where that is refuted.
class AnisotropicRun {
 public:
  AnisotropicRun(const AnisotropicGraph& graph, const SolveOptions& options)
      : graph_(graph),
        options_(options),
        components_(connected_components(graph.scalar())),
        eliminations_(grounded_eliminations(graph.scalar(), components_,
                                            resolve_num_threads(options.iteration.num_threads))),
        lower_bounds_(components_.nodes.size()) {}

  Solution operator()(std::optional<Rotations> start) {
    Solution solution;
    const Rotations R =
        start ? checked_rotations(graph_.scalar(), *std::move(start)) : initial_value(solution);
    solution.timings.init = watch_.seconds();
    if (options_.method == Method::staircase && options_.max_rank >= first_rank) {
      climb(R, solution);
    } else {
      descend(R, solution);
    }
    constexpr int most_times = 3;
    for (int k = 0; k < most_times && chooses() && polish(solution); ++k) {
    }
    if (chooses() && is_refuted(solution)) try_chordal_start(solution);
    if (options_.method == Method::automatic && options_.max_rank >= first_rank &&
        is_refuted(solution)) {
      climb(solution.rotations, solution);
    }
    return solution;
  }

 private:
  static constexpr double max_flops = 5e10;
  static constexpr int first_rank = StaircaseOf<Minorant>::first_rank;

  /// Whether the descent is left to choose.
  bool chooses() const {
    return options_.method == Method::automatic || options_.method == Method::staircase ||
           options_.method == Method::bcdsr;
  }
  bool is_scalar_first() const { return chooses() && options_.method != Method::staircase; }
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
    return rotavg::polish(solution, options_.certificate.tolerance, limits(solution), go_on,
                          [this](Solution& next) { certify(next); });
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
    solution.method = Method::newton;
    solution.reason +=
        "newton on the covariances after " + std::to_string(sweeps) + " sweeps of bcd";
    IterationOptions first = limits;
    first.max_iterations = std::min(sweeps, limits.max_iterations);
    IterationResult result = bcd(graph_, R, first);
    if (result.status != Status::iteration_limit || limits.max_iterations <= sweeps) return result;
    const Rotations swept = result.rotations;
    append(result, newton(graph_, swept, eliminations_, remaining(limits, result)));
    return result;
  }

  bool is_refuted(const Solution& solution) const {
    return solution.certificate.shortfall == Shortfall::negative && is_converged(solution.status) &&
           may_go_on(solution);
  }

  void try_chordal_start(Solution& solution) {
    const double before = watch_.seconds();
    const auto R =
        chordal_init(graph_.scalar(), eliminations_, max_flops, options_.iteration.keep_going);
    if (!R) return;
    Solution second = continued(solution);
    second.timings.init += watch_.seconds() - before;
    second.init = Initialization::chordal;
    try_from(*R, "the chordal start", std::move(second), solution);
  }

  /// Up the staircase of the minorant, and down from every step, in all components that are not
  /// proved, until they are, or its relaxation is solved, or a limit is reached; then that is a
  /// bound.
  /// @param R where to start
  /// @param solution not run yet, or what is refuted at R; the better one stays
  void climb(const Rotations& R, Solution& solution) {
    double before = watch_.seconds();
    const int num_threads = resolve_num_threads(options_.iteration.num_threads, graph_.num_edges());
    const Minorant minorant(graph_, to_quaternions(R), num_threads);
    const auto keep_going = [this] {
      return time_left() > 0.0 &&
             (!options_.iteration.keep_going || options_.iteration.keep_going());
    };
    std::vector<std::unique_ptr<StaircaseOf<Minorant>>> stairs(components_.nodes.size());
    const auto is_proved = [&](Index c) {
      const auto& parts = solution.certificate.components;
      return !parts.empty() && parts[c].verdict == Verdict::proved;
    };
    for (Index c = 0; c < components_.size(); ++c) {
      if (components_.nodes[c].size() < 2 || is_proved(c)) continue;
      stairs[c] = std::make_unique<StaircaseOf<Minorant>>(
          minorant, components_, c, eliminations_[c], R, max_flops, keep_going);
    }
    Index rank = 3;
    int climbed = 0;
    bool better = false;
    for (bool first = true; first || may_go_on(solution); first = false) {
      Rotations top = solution.status == Status::not_run ? R : solution.rotations;
      bool moved = false;
      int iterations = 0;
      for (Index c = 0; c < components_.size(); ++c) {
        StaircaseOf<Minorant>* const part = stairs[c].get();
        if (!part || (!first && is_proved(c))) continue;
        const int spent = part->iterations();
        if (first) {
          part->settle(limits(solution));
          moved = true;
        } else if (part->next_rank() > options_.max_rank || !part->climb(limits(solution))) {
          continue;
        }
        moved = true;
        iterations += part->iterations() - spent;
        rank = std::max(rank, part->rank());
        const Rotations part_R = part->rounded();
        const std::vector<Index>& nodes = components_.nodes[c];
        for (std::size_t a = 0; a < nodes.size(); ++a) top[nodes[a]] = part_R[a];
      }
      if (!moved) break;
      climbed += iterations;
      Solution next = continued(solution);
      next.init = solution.init;
      next.iterations += iterations;
      next.timings.solve += watch_.seconds() - before;
      descend(top, next);
      better |= keep_better(std::move(next), solution);
      if (options_.certify && solution.certificate.verdict == Verdict::proved) break;
      before = watch_.seconds();
    }
    if (options_.certify && solution.certificate.verdict != Verdict::proved && keep_going()) {
      before = watch_.seconds();
      for (Index c = 0; c < components_.size(); ++c) {
        if (stairs[c] && !is_proved(c)) lower_bounds_[c] = stairs[c]->lower_bound();
      }
      solution.timings.certify += watch_.seconds() - before;
      certify(solution);
    }
    if (better) solution.method = Method::staircase;
    solution.reason += "; the staircase climbed to rank " + std::to_string(rank) + " in " +
                       std::to_string(climbed) + " iterations and did " +
                       (better ? "better" : "no better");
  }

  /// In every component the better answer stays.
  /// @returns whether any of `next` has
  bool keep_better(Solution next, Solution& solution) {
    if (solution.status == Status::not_run) {
      solution = std::move(next);
      return true;
    }
    const auto f = objectives(solution.rotations), g = objectives(next.rotations);
    Index better = 0, worse = 0;
    for (Index c = 0; c < components_.size(); ++c) {
      better += g[c] < f[c];
      worse += g[c] > f[c];
    }
    solution.timings = next.timings;
    if (better == 0) {
      solution.iterations = next.iterations;
      return false;
    }
    next.reason = solution.reason;
    if (worse > 0) {  // some of each
      Rotations R = next.rotations;
      for (Index c = 0; c < components_.size(); ++c) {
        if (!(g[c] > f[c])) continue;
        for (const Index i : components_.nodes[c]) R[i] = solution.rotations[i];
      }
      descend(R, next);
      next.reason = solution.reason;
    }
    solution = std::move(next);
    return true;
  }

  /// Of every component.
  std::vector<double> objectives(const Rotations& R) const {
    const AnisotropicResiduals residuals(graph_, to_quaternions(R), 1);
    std::vector<double> sums(components_.nodes.size(), 0.0);
    for (Index k = 0; k < graph_.num_edges(); ++k) {
      sums[components_.label[graph_.scalar().edges()[k].i]] += residuals()[k].cost;
    }
    return sums;
  }

  /// Nothing yet, after the iterations and the time that were spent.
  static Solution continued(const Solution& before) {
    Solution second;
    second.iterations = before.iterations;
    second.timings = before.timings;
    return second;
  }

  /// A second run; the better solution stays.
  void try_from(const Rotations& R, const char* name, Solution second, Solution& solution) {
    descend(R, second);
    const bool better = second.objective < solution.objective;
    const std::string reason = solution.reason + "; a second run, from " + name + ", did " +
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
  std::vector<LowerBound> lower_bounds_;  ///< on the optimum of every component
};

}  // namespace detail

ROTAVG_INLINE Solution solve(const AnisotropicGraph& graph, const SolveOptions& options,
                             std::optional<Rotations> start) {
  return detail::AnisotropicRun(graph, options)(std::move(start));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

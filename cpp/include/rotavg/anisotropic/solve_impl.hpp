#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/descent.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/stairs.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/solve.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// One call of solve(): from a start to a certified answer, and others where that is refuted.
class AnisotropicRun : private AnisotropicDescent {
 public:
  using AnisotropicDescent::AnisotropicDescent;

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
        (is_refuted(solution) || is_worth_a_climb(solution))) {
      climb(solution.rotations, solution);
    }
    stop_.tell(solution, chooses());
    return solution;
  }

 private:
  static constexpr double max_flops = 5e10;
  static constexpr int first_rank = AnisotropicStairs::first_rank;

  bool is_scalar_first() const { return chooses() && options_.method != Method::staircase; }

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
    const auto keep_going = [this] {
      return time_left() > 0.0 &&
             (!options_.iteration.keep_going || options_.iteration.keep_going());
    };
    const auto is_proved = [&](Index c) {
      const auto& parts = solution.certificate.components;
      return !parts.empty() && parts[c].verdict == Verdict::proved;
    };
    AnisotropicStairs stairs(graph_, components_, eliminations_, R, num_threads, max_flops,
                             keep_going, is_proved);
    bool better = false;
    for (bool first = true; first || may_go_on(solution); first = false) {
      Rotations top = solution.status == Status::not_run ? R : solution.rotations;
      const int climbed = stairs.iterations();
      const auto left = [&] { return limits(solution); };
      if (!stairs.rise(options_.max_rank, left, is_proved, top)) break;
      Solution next = continued(solution);
      next.init = solution.init;
      next.iterations += stairs.iterations() - climbed;
      next.timings.solve += watch_.seconds() - before;
      descend(top, next);
      better |= keep_better(std::move(next), solution);
      if (options_.certify && solution.certificate.verdict == Verdict::proved) break;
      before = watch_.seconds();
    }
    if (options_.certify && solution.certificate.verdict != Verdict::proved && keep_going()) {
      before = watch_.seconds();
      stairs.bound(is_proved, lower_bounds_);
      solution.timings.certify += watch_.seconds() - before;
      certify(solution);
    }
    if (better) solution.method = Method::staircase;
    solution.reason += "; the staircase climbed to rank " + std::to_string(stairs.rank()) + " in " +
                       std::to_string(stairs.iterations()) + " iterations and did " +
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
};

}  // namespace detail

ROTAVG_INLINE Solution solve(const AnisotropicGraph& graph, const SolveOptions& options,
                             std::optional<Rotations> start) {
  return detail::AnisotropicRun(graph, options)(std::move(start));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

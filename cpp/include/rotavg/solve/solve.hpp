#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/init/quaternion.hpp>
#include <rotavg/init/random.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/solve/accelerated.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/bcdsr.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/staircase.hpp>
#include <rotavg/solve/stopwatch.hpp>
#include <rotavg/solve/sum.hpp>

namespace rotavg {

/// Where a linear system would cost too much, or more than the time left, the shortest paths are
/// used instead.
enum class Initialization {
  automatic,
  shortest_path,  ///< Lemma 3
  spanning_tree,  ///< along the edges that the graph supports best
  chordal,        ///< free matrices, then the nearest rotations
  quaternion,     ///< free quaternions, then unit ones
  random,
};

struct SolveOptions {
  Method method = Method::automatic;
  Initialization init = Initialization::automatic;
  std::uint64_t seed = 0;  ///< of the random initial value
  MuRule mu = MuRule::adaptive;
  bool accelerate = false;  ///< Anderson's mixing, of BCD and SUM; the others have no use for it
  bool certify = true;
  /// How high the staircase climbs, by the automatic choice or by Method::staircase; below
  /// Staircase::first_rank it is not used.
  int max_rank = 10;
  CertificateOptions certificate;  ///< its threads and keep_going are set from `iteration`
  IterationOptions iteration;      ///< its time limit counts for everything together
};

struct Timings {
  double init = 0.0;
  double solve = 0.0;
  double certify = 0.0;
};

struct Solution : IterationResult {
  Method method = Method::automatic;  ///< the one that was used, in the end
  std::string reason;                 ///< what Method::automatic chose and why, in one line
  Initialization init = Initialization::automatic;
  Certificate certificate;
  Components components;
  Timings timings;  ///< seconds
};

namespace detail {

/// One call of solve(): what its runs from several initial values share.
class FrontDoor {
 public:
  /// @param graph, options must outlive this object
  FrontDoor(const MeasurementGraph& graph, const SolveOptions& options)
      : graph_(graph),
        options_(options),
        components_(connected_components(graph)),
        eliminations_(grounded_eliminations(graph, components_)),
        keep_going_([this] {
          return time_left() > 0.0 &&
                 (!options_.iteration.keep_going || options_.iteration.keep_going());
        }) {}

  FrontDoor(const FrontDoor&) = delete;
  FrontDoor& operator=(const FrontDoor&) = delete;

  Solution solve(std::optional<Rotations> given) {
    const bool automatic = options_.method == Method::automatic;
    const bool free_choice = automatic && !given && options_.init == Initialization::automatic;
    Solution solution;
    Rotations start = given ? checked_rotations(graph_, std::move(*given))
                            : initial_value(options_.init, solution.init);
    solution.timings.init = watch_.seconds();
    if (options_.method == Method::staircase) {
      climb_from(std::move(start), solution);
    } else {
      run_from(start, options_.method, solution, given.has_value());
      if (free_choice && is_refuted(solution)) try_chordal_start(solution);
      if (automatic && is_refuted(solution)) climb_from(solution.rotations, solution);
    }
    return solution;
  }

 private:
  double time_left() const { return options_.iteration.time_limit - watch_.seconds(); }

  /// What is left of the caller's limits.
  IterationOptions limits() const {
    IterationOptions rest = options_.iteration;
    rest.time_limit = time_left();
    rest.max_iterations = std::max(0, rest.max_iterations - iterations_);
    return rest;
  }

  bool may_go_on() const { return keep_going_() && limits().max_iterations > 0; }

  /// Whether a solution has converged to something that is not certified, and there is time left.
  bool is_refuted(const Solution& solution) const {
    return options_.certify && is_converged(solution.status) &&
           solution.certificate.verdict == Verdict::not_certified && may_go_on();
  }

  /// @param used receives what was used: the shortest paths where a linear system would cost more
  ///        than options.certificate.max_factorization_flops, or the time is up
  Rotations initial_value(Initialization init, Initialization& used) {
    const double max_flops = options_.certificate.max_factorization_flops;
    std::optional<Rotations> R;
    used = init;
    switch (init) {
      case Initialization::spanning_tree:
        return spanning_tree_init(graph_);
      case Initialization::random:
        return random_init(graph_, options_.seed);
      case Initialization::chordal:
        R = chordal_init(graph_, eliminations_, max_flops, keep_going_);
        break;
      case Initialization::quaternion:
        R = quaternion_init(graph_, eliminations_, max_flops, keep_going_);
        break;
      case Initialization::automatic:
      case Initialization::shortest_path:
        break;
    }
    if (R) return *std::move(R);
    used = Initialization::shortest_path;
    return shortest_path_init(graph_);
  }

  /// From one initial value: solved, gauge fixed, certified.
  /// @param given whether R is the caller's
  void run_from(const Rotations& R, Method method, Solution& solution, bool given = false) {
    const double before = watch_.seconds();
    solution.method = method;
    static_cast<IterationResult&>(solution) = iterate(R, method, given, solution);
    iterations_ += solution.iterations;
    solution.certificate = Certificate{};  // an older one is of other rotations
    solution.components = components_;
    fix_gauge(components_, solution.rotations);
    solution.timings.solve += watch_.seconds() - before;
    certify_solution(solution);
  }

  IterationResult iterate(const Rotations& R, Method method, bool given, Solution& solution) {
    const bool accelerate = options_.accelerate;
    switch (method) {
      case Method::bcd:
        return accelerate ? accelerated_bcd(graph_, R, limits()) : bcd(graph_, R, limits());
      case Method::sum:
        return accelerate ? accelerated_sum(graph_, R, limits(), options_.mu)
                          : sum(graph_, R, limits(), options_.mu);
      case Method::newton:
        return newton(graph_, R, limits());
      case Method::bcdsr:
        return bcdsr(graph_, R, limits());
      case Method::automatic:
      case Method::staircase:
        break;
    }
    return solve_automatically(graph_, eliminations_, R, limits(), given, solution.method,
                               solution.reason);
  }

  void certify_solution(Solution& solution) {
    const bool interrupted = options_.iteration.keep_going && !options_.iteration.keep_going();
    if (!options_.certify || interrupted) return;
    const double before = watch_.seconds();
    CertificateOptions certificate = options_.certificate;
    certificate.num_threads = options_.iteration.num_threads;
    certificate.keep_going = keep_going_;
    solution.certificate = rotavg::certify(graph_, solution.rotations, components_, eliminations_,
                                           certificate, lower_bounds_);
    solution.timings.certify += watch_.seconds() - before;
  }

  /// A second run; the better solution stays.
  void try_chordal_start(Solution& solution) {
    const double before = watch_.seconds();
    Solution second;
    const Rotations R = initial_value(Initialization::chordal, second.init);
    solution.timings.init += watch_.seconds() - before;
    if (second.init != Initialization::chordal) return;
    second.timings = solution.timings;
    run_from(R, Method::automatic, second);
    const bool better = is_better(second, solution);
    solution.timings = second.timings;
    if (better) solution = std::move(second);
    solution.reason += better ? "; a second run, from the chordal start, did better"
                              : "; a second run, from the chordal start, did no better";
  }

  /// Whether a is to replace b. A certified answer wins a tie, for its certificate; but where b is
  /// lower by more than the gap, the certificate of a, an estimate, is wrong.
  static bool is_better(const Solution& a, const Solution& b) {
    const bool certified =
        a.certificate.verdict == Verdict::proved || a.certificate.verdict == Verdict::estimated;
    return certified ? a.objective <= b.objective + a.certificate.gap : a.objective < b.objective;
  }

  bool is_certified(const Solution& solution, Index c) const {
    const auto& parts = solution.certificate.components;
    return !parts.empty() && parts[c].verdict != Verdict::not_certified;
  }

  /// Up the staircase, component by component, and down from every step, until what is met there is
  /// certified, or the relaxation is solved, or a limit is reached.
  /// @param R where to start
  /// @param solution not run yet, or what is refuted at R; the better one stays
  void climb_from(Rotations R, Solution& solution) {
    std::string report;
    lower_bounds_.assign(components_.nodes.size(), LowerBound{});
    for (Index c = 0; c < components_.size(); ++c) {
      if (components_.nodes[c].size() < 2 || is_certified(solution, c)) continue;
      if (solution.status != Status::not_run) R = solution.rotations;
      double before = watch_.seconds();
      Staircase staircase(graph_, components_, c, eliminations_[c], R,
                          resolve_num_threads(options_.iteration.num_threads, graph_.num_edges()),
                          options_.certificate.max_factorization_flops, keep_going_);
      while (staircase.next_rank() <= options_.max_rank && may_go_on()) {
        const int iterations = staircase.iterations();
        const bool climbed = staircase.climb(limits());
        iterations_ += staircase.iterations() - iterations;
        solution.timings.solve += watch_.seconds() - before;
        if (!climbed) break;
        go_down(staircase.rounded(), solution);
        if (is_certified(solution, c)) break;
        before = watch_.seconds();
      }
      if (staircase.iterations() == 0) continue;
      if (options_.certify && !is_certified(solution, c)) {
        before = watch_.seconds();
        lower_bounds_[c] = staircase.lower_bound();
        solution.timings.certify += watch_.seconds() - before;
        certify_solution(solution);
      }
      report = staircase.report(is_certified(solution, c));
    }
    if (solution.status == Status::not_run) run_from(R, Method::automatic, solution);
    if (report.empty()) return;
    solution.method = Method::staircase;
    solution.reason += (solution.reason.empty() ? "" : "; ") + report;
  }

  /// The way down from the staircase: a run from what it came to; the better solution stays.
  void go_down(const Rotations& R, Solution& solution) {
    Solution next = solution;
    run_from(R, Method::automatic, next);
    if (solution.status == Status::not_run || is_better(next, solution)) {
      next.reason = solution.reason;
      solution = std::move(next);
    } else {
      solution.timings = next.timings;
    }
  }

  const MeasurementGraph& graph_;
  const SolveOptions& options_;
  const Stopwatch watch_;
  const Components components_;
  std::vector<Elimination> eliminations_;
  const std::function<bool()> keep_going_;
  std::vector<LowerBound> lower_bounds_;  ///< on the optimum of every component; empty: none known
  int iterations_ = 0;                    ///< of all runs
};

}  // namespace detail

/// Finds the rotations that fit the measurements best, and certifies them. In every component the
/// first node has R = I.
///
/// Where the method is left to choose, an answer that has converged but is refuted is not the end:
/// if the start is left to choose as well, a second answer from the chordal start is computed; and
/// if that is refuted, too, the staircase is climbed. The best rotations are returned, with the
/// best bound.
///
/// @param start an initial value to use instead of options.init (a warm start)
/// @throws std::invalid_argument unless `start` holds a rotation for each node, and if bcdsr's
///         dense matrix does not fit in memory
inline Solution solve(const MeasurementGraph& graph, const SolveOptions& options = {},
                      std::optional<Rotations> start = std::nullopt) {
  return detail::FrontDoor(graph, options).solve(std::move(start));
}

}  // namespace rotavg

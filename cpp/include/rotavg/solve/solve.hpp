#pragma once

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

/// Whether there is time left and nobody wants the work to stop.
inline std::function<bool()> keep_going(const SolveOptions& options, const Stopwatch& watch) {
  return [&] {
    return watch.seconds() < options.iteration.time_limit &&
           (!options.iteration.keep_going || options.iteration.keep_going());
  };
}

/// @returns none where it would cost more than options.certificate.max_factorization_flops, or the
///          time is up
inline std::optional<Rotations> initial_value(const MeasurementGraph& graph,
                                              std::vector<Elimination>& eliminations,
                                              Initialization init, const SolveOptions& options,
                                              const Stopwatch& watch) {
  const double max_flops = options.certificate.max_factorization_flops;
  switch (init) {
    case Initialization::spanning_tree:
      return spanning_tree_init(graph);
    case Initialization::chordal:
      return chordal_init(graph, eliminations, max_flops, keep_going(options, watch));
    case Initialization::quaternion:
      return quaternion_init(graph, eliminations, max_flops, keep_going(options, watch));
    case Initialization::random:
      return random_init(graph, options.seed);
    case Initialization::automatic:
    case Initialization::shortest_path:
      break;
  }
  return shortest_path_init(graph);
}

/// Rotations of one initial value: solved, gauge fixed, certified.
inline void run_from(const MeasurementGraph& graph, const SolveOptions& options,
                     const Stopwatch& watch, std::vector<Elimination>& eliminations,
                     const Rotations& R, Solution& solution) {
  const double before = watch.seconds();
  IterationOptions iteration = options.iteration;
  iteration.time_limit -= before;
  static_cast<IterationResult&>(solution) = [&] {
    switch (options.method) {
      case Method::bcd:
        return options.accelerate ? accelerated_bcd(graph, R, iteration) : bcd(graph, R, iteration);
      case Method::sum:
        return options.accelerate ? accelerated_sum(graph, R, iteration, options.mu)
                                  : sum(graph, R, iteration, options.mu);
      case Method::newton:
        return newton(graph, R, iteration);
      case Method::bcdsr:
        return bcdsr(graph, R, iteration);
      case Method::automatic:
        break;
    }
    return solve_automatically(graph, eliminations, R, iteration, solution.method, solution.reason);
  }();
  fix_gauge(solution.components, solution.rotations);
  const double solved = watch.seconds();
  solution.timings.solve += solved - before;

  const bool interrupted = options.iteration.keep_going && !options.iteration.keep_going();
  if (!options.certify || interrupted) return;
  CertificateOptions certificate = options.certificate;
  certificate.num_threads = options.iteration.num_threads;
  certificate.keep_going = keep_going(options, watch);
  solution.certificate =
      rotavg::certify(graph, solution.rotations, solution.components, eliminations, certificate);
  solution.timings.certify += watch.seconds() - solved;
}

}  // namespace detail

/// Finds the rotations that fit the measurements best, and certifies them. In every component the
/// first node has R = I.
///
/// Where everything is left to choose and the answer from the shortest-path start has converged but
/// is not certified, a second answer from the chordal start is computed, and the better one
/// returned.
///
/// @param start an initial value to use instead of options.init (a warm start)
/// @throws std::invalid_argument unless `start` holds a rotation for each node, and if bcdsr's
///         dense matrix does not fit in memory
inline Solution solve(const MeasurementGraph& graph, const SolveOptions& options = {},
                      std::optional<Rotations> start = std::nullopt) {
  const Stopwatch watch;
  const bool free_choice =
      !start && options.method == Method::automatic && options.init == Initialization::automatic;
  Solution solution;
  solution.components = connected_components(graph);
  solution.method = options.method;
  solution.init =
      options.init == Initialization::automatic ? Initialization::shortest_path : options.init;
  const Components components = solution.components;  // solutions are moved about
  std::vector<Elimination> eliminations = grounded_eliminations(graph, components);
  if (start) {
    start = checked_rotations(graph, std::move(*start));
  } else {
    start = detail::initial_value(graph, eliminations, solution.init, options, watch);
    if (!start) {
      solution.init = Initialization::shortest_path;
      start = shortest_path_init(graph);
    }
  }
  solution.timings.init = watch.seconds();
  detail::run_from(graph, options, watch, eliminations, *start, solution);

  if (free_choice && options.certify && is_converged(solution.status) &&
      solution.certificate.verdict == Verdict::not_certified) {
    const double before = watch.seconds();
    if (std::optional<Rotations> second_start =
            detail::initial_value(graph, eliminations, Initialization::chordal, options, watch)) {
      Solution second = solution;
      second.init = Initialization::chordal;
      second.timings.init += watch.seconds() - before;
      detail::run_from(graph, options, watch, eliminations, *second_start, second);
      const bool better = second.certificate.verdict != Verdict::not_certified ||
                          second.objective < solution.objective;
      second.reason += better ? "; a second run, from the chordal start, did better"
                              : "; a second run, from the chordal start, did no better";
      if (better) return second;
      solution.reason = second.reason;
      solution.timings = second.timings;
    }
  }
  return solution;
}

}  // namespace rotavg

#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/random.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/sum.hpp>

namespace rotavg {

enum class Method {
  automatic,
  bcd,     ///< block coordinate descent, Algorithm 2
  sum,     ///< successive upper-bound minimisation, Algorithm 3
  newton,  ///< Newton's method in the metric of the graph Laplacian
};

enum class Initialization {
  automatic,
  shortest_path,  ///< Lemma 3
  random,
};

struct SolveOptions {
  Method method = Method::automatic;
  Initialization init = Initialization::automatic;
  std::uint64_t seed = 0;  ///< of the random initial value
  MuRule mu = MuRule::adaptive;
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
  Method method = Method::automatic;  ///< the one that was asked for
  std::string reason;                 ///< what Method::automatic chose and why, in one line
  Initialization init = Initialization::automatic;
  Certificate certificate;
  Components components;
  Timings timings;  ///< seconds
};

/// Finds the rotations that fit the measurements best, and certifies them. In every component the
/// first node has R = I.
///
/// @param start an initial value to use instead of options.init (a warm start)
/// @throws std::invalid_argument unless `start` holds a rotation for each node
inline Solution solve(const MeasurementGraph& graph, const SolveOptions& options = {},
                      std::optional<Rotations> start = std::nullopt) {
  const Stopwatch watch;
  Solution solution;
  solution.components = connected_components(graph);
  solution.method = options.method;
  solution.init =
      options.init == Initialization::automatic ? Initialization::shortest_path : options.init;

  Rotations R = start ? checked_rotations(graph, std::move(*start))
                : solution.init == Initialization::shortest_path ? shortest_path_init(graph)
                                                                 : random_init(graph, options.seed);
  solution.timings.init = watch.seconds();

  IterationOptions iteration = options.iteration;
  iteration.time_limit -= watch.seconds();
  static_cast<IterationResult&>(solution) = [&] {
    switch (options.method) {
      case Method::bcd:
        return bcd(graph, std::move(R), iteration);
      case Method::sum:
        return sum(graph, std::move(R), iteration, options.mu);
      case Method::newton:
        return newton(graph, std::move(R), iteration);
      case Method::automatic:
        break;
    }
    return solve_automatically(graph, solution.components, std::move(R), iteration,
                               solution.reason);
  }();
  fix_gauge(solution.components, solution.rotations);
  solution.timings.solve = watch.seconds() - solution.timings.init;

  const bool interrupted = options.iteration.keep_going && !options.iteration.keep_going();
  if (options.certify && !interrupted) {
    CertificateOptions certificate = options.certificate;
    certificate.num_threads = options.iteration.num_threads;
    certificate.keep_going = [&] {
      return watch.seconds() < options.iteration.time_limit &&
             (!options.iteration.keep_going || options.iteration.keep_going());
    };
    solution.certificate = rotavg::certify(graph, solution.rotations, certificate);
    solution.timings.certify = watch.seconds() - solution.timings.init - solution.timings.solve;
  }
  return solution;
}

}  // namespace rotavg

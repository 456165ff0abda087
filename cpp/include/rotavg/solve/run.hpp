#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/known_cut.hpp>
#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/init/multilevel.hpp>
#include <rotavg/init/quaternion.hpp>
#include <rotavg/init/random.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/solve/accelerated.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/bcdsr.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/polish.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/solve/stop_request.hpp>
#include <rotavg/solve/stopwatch.hpp>
#include <rotavg/solve/sum.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What the runs of one call of solve() share: the limits, the watch, the analysis of the graph.
class SolveRun {
 public:
  /// @param graph must outlive this object
  /// @param gravity of the edges; its constant is no part of what a gap is held against
  SolveRun(const MeasurementGraph& graph, const SolveOptions& options, GravityPairs gravity = {})
      : graph_(graph),
        options_(stop_.heeding(options)),
        gravity_(std::move(gravity)),
        forest_(breadth_first_forest(graph)),
        components_(connected_components(forest_)),
        eliminations_(grounded_eliminations(graph, components_,
                                            resolve_num_threads(options.iteration.num_threads))),
        lower_bounds_(components_.nodes.size()),
        keep_going_([this] {
          return time_left() > 0.0 &&
                 (!options_.iteration.keep_going || options_.iteration.keep_going());
        }) {
    check(options_);
  }

  SolveRun(const SolveRun&) = delete;
  SolveRun& operator=(const SolveRun&) = delete;

  const MeasurementGraph& graph() const { return graph_; }
  const SolveOptions& options() const { return options_; }
  const Components& components() const { return components_; }
  std::vector<Elimination>& eliminations() { return eliminations_; }
  const std::function<bool()>& keep_going() const { return keep_going_; }
  double seconds() const { return watch_.seconds(); }

  /// What is left of the caller's limits; the callback goes on counting where the last run ended.
  IterationOptions limits() {
    IterationOptions rest = options_.iteration;
    rest.time_limit = std::max(0.0, time_left());
    if (rest.max_iterations > 0)
      rest.max_iterations = std::max(0, rest.max_iterations - iterations_);
    if (rest.callback) {
      rest.callback = [this, before = iterations_, began = watch_.seconds(),
                       first = std::exchange(is_first_, false)](Progress progress) {
        if (progress.iteration == 0 && !first) return !stop_.made();
        progress.iteration += before;
        progress.seconds += began;
        return options_.iteration.callback(progress);
      };
    }
    return rest;
  }

  bool may_go_on() const {
    return !stop_.made() && keep_going_() && iterations_ < options_.iteration.max_iterations;
  }
  const StopRequest& stop() const { return stop_; }

  /// Of all runs, and of what else was counted.
  int iterations() const { return iterations_; }
  void count(int iterations) { iterations_ += iterations; }

  /// No linear system of a start, nor of the staircase, takes more operations to factorise.
  double max_start_flops() const {
    constexpr double limit = 3e11;  // half a minute
    return std::min(limit, options_.certificate.max_factorization_flops);
  }

  /// @param used receives what was used: the shortest paths where a linear system would cost more
  ///        than max_start_flops(), coarser graphs would be no smaller, or the time is up
  Rotations initial_value(Initialization init, Initialization& used) {
    const double max_flops = max_start_flops();
    std::optional<Rotations> R;
    used = init;
    switch (init) {
      case Initialization::spanning_tree:
        return spanning_tree_init(graph_, keep_going_);
      case Initialization::maximum_spanning_tree:
        return maximum_spanning_tree_init(graph_, keep_going_);
      case Initialization::random:
        return random_init(graph_, options_.seed);
      case Initialization::chordal:
        R = chordal_init(graph_, eliminations_, max_flops, keep_going_);
        break;
      case Initialization::quaternion:
        R = quaternion_init(graph_, eliminations_, max_flops, keep_going_);
        break;
      case Initialization::multilevel:
        R = multilevel_init(graph_, options_.iteration.num_threads, keep_going_);
        break;
      case Initialization::automatic:
        return automatic_initial_value(used);
      case Initialization::shortest_path:
        break;
    }
    if (R) return *std::move(R);
    used = Initialization::shortest_path;
    return shortest_path_init(graph_, forest_);
  }

  /// Where an initial value comes from.
  enum class Origin {
    given,      ///< the caller
    automatic,  ///< the choice is left to us: where Newton's method wanders, it may be the chordal
    named,      ///< by the caller
    other,
  };

  /// From one initial value: solved, gauge fixed, certified; where the method is left to choose,
  /// with the steps that the proof needs.
  /// @param solution what it holds of earlier runs, such as their timings, stays or is added to
  void from(const Rotations& R, Method method, Solution& solution, Origin origin = Origin::other) {
    const double before = watch_.seconds();
    solution.method = method;
    static_cast<IterationResult&>(solution) = iterate(R, method, origin, solution);
    iterations_ += solution.iterations;
    solution.certificate = Certificate{};  // an older one is of other rotations
    solution.components = components_;
    fix_gauge(components_, solution.rotations);
    solution.timings.solve += watch_.seconds() - before;
    certify(solution);
    constexpr int most_times = 3;
    for (int k = 0; k < most_times && method == Method::automatic && polish(solution); ++k) {
    }
  }

  void certify(Solution& solution) {
    const bool interrupted = options_.iteration.keep_going && !options_.iteration.keep_going();
    if (!options_.certify || interrupted) return;
    const double before = watch_.seconds();
    CertificateOptions certificate = options_.certificate;
    certificate.num_threads = options_.iteration.num_threads;
    certificate.keep_going = keep_going_;
    solution.certificate = rotavg::certify(graph_, solution.rotations, components_, eliminations_,
                                           certificate, lower_bounds_, gravity_, &cuts_);
    solution.timings.certify += watch_.seconds() - before;
  }

  /// What is known of the optimum of component c besides; certificates use it.
  LowerBound& lower_bound(Index c) { return lower_bounds_[c]; }

 private:
  /// The shortest paths, which the paper's algorithms start from; for others coarser graphs, where
  /// a share of the paths is long, so that noise adds up along them, and there are cycles to
  /// correct it. (The two edges of gravity are half a turn apart: their mean would say nothing.)
  Rotations automatic_initial_value(Initialization& used) {
    constexpr double share = 0.1;
    const bool by_paper = options_.method == Method::bcd || options_.method == Method::sum ||
                          options_.method == Method::bcdsr;
    const bool has_cycles = graph_.num_edges() > graph_.num_nodes() - components_.size();
    const bool by_levels = !by_paper && has_cycles && gravity_.first.empty() &&
                           num_far_nodes() > share * graph_.num_nodes();
    const bool sparse = 2.0 * graph_.num_edges() <= sparse_degree * graph_.num_nodes();
    const bool is_asked_for = options_.certify || options_.method != Method::newton;
    int num_threads = resolve_num_threads(options_.iteration.num_threads, graph_.num_edges());
    std::future<void> analysis;
    if (num_threads > 1 && is_asked_for && has_cycles && !by_paper && (by_levels || sparse)) {
      analysis = analyse_beside();
      --num_threads;
    }
    std::optional<Rotations> R;
    if (by_levels) R = multilevel_init(graph_, num_threads, keep_going_);
    used = R ? Initialization::multilevel : Initialization::shortest_path;
    if (!R) R = shortest_path_init(graph_, forest_);
    if (!keep_going_()) analysis_is_wanted_ = false;
    if (analysis.valid()) analysis.get();
    return *std::move(R);
  }

  /// Begins, on a thread of its own, what Newton's steps and the proof will ask for unless the
  /// graph fills in: the orders of elimination and their analysis. Nobody else may ask for them
  /// before the end of what is returned, which waits.
  std::future<void> analyse_beside() {
    const double limit = flops_of_sweeps(graph_, filled_sweeps);
    try {
      return std::async(std::launch::async, [this, limit] {
        for (Elimination& elimination : eliminations_) {
          if (analysis_is_wanted_) elimination.prepare(limit);
        }
      });
    } catch (const std::system_error&) {
      return {};  // the system gives no thread: it is made when it is asked for
    }
  }

  /// Nodes that are farther from the root of their component than those of random graphs.
  Index num_far_nodes() const {
    constexpr double far = 2.0;  // times log2 of the number of nodes
    Index count = 0;
    for (const std::vector<Index>& nodes : components_.nodes) {
      const double least = far * std::log2(static_cast<double>(nodes.size()));
      count += static_cast<Index>(std::count_if(nodes.begin(), nodes.end(),
                                                [&](Index i) { return forest_.depth[i] > least; }));
    }
    return count;
  }

  /// @returns whether more steps have made the gap smaller
  bool polish(Solution& solution) {
    if (!is_leftover(solution.certificate) || !is_converged(solution.status) || !may_go_on()) {
      return false;
    }
    const auto go_on = [this](const IterationOptions& options, Solution& next) {
      const double before = watch_.seconds();
      const int iterations = next.iterations;
      const Rotations R = next.rotations;
      std::string reason;
      append(next, solve_automatically(
                       graph_, eliminations_, R, options,
                       next.method == Method::newton ? StartsFrom::newton : StartsFrom::given,
                       next.method, reason));
      iterations_ += next.iterations - iterations;
      fix_gauge(components_, next.rotations);
      next.timings.solve += watch_.seconds() - before;
    };
    const bool by_sweeps = solution.method != Method::newton;
    return rotavg::polish(solution, options_.certificate.tolerance, limits(), by_sweeps, go_on,
                          [this](Solution& next) { certify(next); });
  }

  double time_left() const { return options_.iteration.time_limit - watch_.seconds(); }

  IterationResult iterate(const Rotations& R, Method method, Origin origin, Solution& solution) {
    const IterationOptions limits = this->limits();
    switch (method) {
      case Method::bcd:
        return options_.accelerate ? accelerated_bcd(graph_, R, limits) : bcd(graph_, R, limits);
      case Method::sum:
        return options_.accelerate ? accelerated_sum(graph_, R, limits, options_.mu)
                                   : sum(graph_, R, limits, options_.mu);
      case Method::newton:
        return newton(graph_, R, limits);
      case Method::bcdsr:
        return bcdsr(graph_, R, limits);
      case Method::automatic:
      case Method::staircase:
        break;
    }
    OtherStart chordal{[this]() -> std::optional<Rotations> {
      constexpr double flops_an_edge = 1e5;  // some tens of Newton's steps take as long
      const double limit = std::min(max_start_flops(), flops_an_edge * graph_.num_edges());
      const auto start = chordal_init(graph_, eliminations_, limit, keep_going_);
      if (!start) return std::nullopt;
      // As it comes, the noise of every node is still in it.
      IterationOptions sweeps;
      sweeps.max_iterations = 3;
      sweeps.num_threads = options_.iteration.num_threads;
      sweeps.keep_going = keep_going_;
      return bcd(graph_, *start, sweeps).rotations;
    }};
    const bool automatic = origin == Origin::automatic;
    const bool has_levels =
        (automatic || origin == Origin::named) && solution.init == Initialization::multilevel;
    const StartsFrom from = origin == Origin::given ? StartsFrom::given
                            : has_levels            ? StartsFrom::smoothed
                                                    : StartsFrom::initial_value;
    IterationResult result =
        solve_automatically(graph_, eliminations_, R, limits, from, solution.method,
                            solution.reason, automatic ? &chordal : nullptr);
    if (chordal.is_used) solution.init = Initialization::chordal;
    return result;
  }

  const MeasurementGraph& graph_;
  const StopRequest stop_;
  const SolveOptions options_;
  const GravityPairs gravity_;
  const Stopwatch watch_;
  const BreadthFirstForest forest_;
  const Components components_;
  std::vector<Elimination> eliminations_;
  std::vector<LowerBound> lower_bounds_;  ///< on the optimum of every component
  std::vector<KnownCut> cuts_;            ///< of the certificates so far
  const std::function<bool()> keep_going_;
  int iterations_ = 0;  ///< of all runs
  bool is_first_ = true;
  std::atomic<bool> analysis_is_wanted_{true};  ///< of those that have not begun
};

}  // namespace rotavg

#pragma GCC diagnostic pop

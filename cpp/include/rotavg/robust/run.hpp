#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/gnc.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/irls.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/some_edges.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/stop_request.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How edges are judged while most may still be wrong, and afterwards.
enum class Judging {
  in_own_units,         ///< residuals in units of their precision; trusted edges as they are
  freely_in_own_units,  ///< the same, and trusted edges are edges like any other
  evenly,  ///< every edge has one voice (EdgeUnits::voices), and residuals are as they are
  freely_and_evenly,  ///< the same, and trusted edges are edges like any other
};

/// The stages of a robust solution, which share the limits, the callback and the watch.
class RobustRun {
 public:
  /// @param graph whose weights are the given ones
  /// @param series of its edges
  /// @param watch that has been running since the call began
  RobustRun(const MeasurementGraph& graph, const SolveOptions& options, Series series,
            EdgeUnits units, const Stopwatch& watch)
      : watch_(watch),
        graph_(graph),
        given_(graph.weights()),
        units_(units),
        units_at_first_(std::move(units)),
        series_(std::move(series)),
        options_(stop_.heeding(options)),
        num_threads_(resolve_num_threads(options.iteration.num_threads, graph.num_edges())),
        inner_(inner_steps(graph_, options.method, num_threads_)) {
    note_trust();
    judged_by_ = precision_for(judging_);
  }

  RobustRun(const RobustRun&) = delete;
  RobustRun& operator=(const RobustRun&) = delete;

  const std::vector<double>& given() const { return given_; }
  const std::vector<double>& precision() const { return units_.precision; }
  /// The same as if no edge were trusted.
  const std::vector<double>& free_precision() const {
    return trusts_any() ? units_.free_precision : units_.precision;
  }
  const std::vector<double>& squared_residuals_at(const Rotations& R) {
    squared_residuals(graph_, to_quaternions(R), num_threads_, x_);
    return x_;
  }
  /// What every series of edges leaves over, in units of its precision.
  std::vector<double> series_residuals_at(const Rotations& R) {
    return series_residuals(series_, squared_residuals_at(R),
                            judges_freely() ? free_precision() : precision());
  }
  /// The estimated standard deviation of the noise angle, radians, of an edge of precision 1.
  double noise_at(const Rotations& R) {
    return noise_beside_tree(series_residuals_at(R), series_.num_cycles);
  }
  /// The same of rotations along a spanning tree.
  double noise_off_tree_at(const Rotations& R) {
    return noise_off_tree(series_residuals_at(R), series_.num_cycles);
  }
  double objective_at(const Rotations& R, const RobustLoss& loss) {
    return robust_objective(given_, squared_residuals_at(R), loss, judged_by(), num_threads_);
  }
  int num_threads() const { return num_threads_; }
  int iterations() const { return iterations_; }
  /// How the work has ended before its time; not_run if it may go on.
  Status ended() const { return ended_; }
  double seconds() const { return watch_.seconds(); }
  /// For what is not a stage of its own.
  std::function<bool()> keep_going() const {
    return [this] {
      return !stop_.made() && watch_.seconds() < options_.iteration.time_limit &&
             (!options_.iteration.keep_going || options_.iteration.keep_going());
    };
  }
  /// From now on.
  void judge(Judging judging) {
    judging_ = judging;
    judged_by_ = precision_for(judging);
    favour(favoured_, judged_by_);
    if (units_.voices.empty()) return;
    if (judging == Judging::evenly) {
      graph_.set_weights(units_.voices);
    } else if (judging == Judging::freely_and_evenly) {
      std::vector<double> voices = units_.voices;
      for (std::size_t k = 0; k < trusting_.size(); ++k) {
        if (trusting_[k] == 0.0) voices[k] = units_.voice;
      }
      graph_.set_weights(voices);
    } else {
      graph_.set_weights(given_);
    }
  }
  /// In their own units from now on, trusted or free as before.
  void judge_in_own_units() {
    judge(judges_freely() ? Judging::freely_in_own_units : Judging::in_own_units);
  }
  /// (m,) the precisions by which residuals are judged now; empty: all 1.
  const std::vector<double>& judged_by() const { return judged_by_; }
  /// From now on this odometry (m,), or none, is favoured (edge_knowledge.hpp).
  void favour_odometry(std::vector<bool> odometry) {
    favoured_ = std::move(odometry);
    judge(judging_);
  }

  /// From now on these edges (m,) are trusted, beside those that are from the beginning.
  void trust(const std::vector<bool>& edges) {
    units_ = units_at_first_;
    rotavg::trust(edges, given_, units_);
    note_trust();
    judge(judging_);
  }
  bool trusts(Index k) const { return !trusting_.empty() && trusting_[k] == 0.0; }
  std::vector<bool> trusted() const {
    std::vector<bool> edges;
    for (Index k = 0; k < graph_.num_edges(); ++k) edges.push_back(trusts(k));
    return edges;
  }
  bool trusts_any() const { return !trusting_.empty(); }
  bool trusts_all() const {
    return trusts_any() &&
           std::all_of(trusting_.begin(), trusting_.end(), [](double one) { return one == 0.0; });
  }
  /// Whether some edges weigh more, as more precise ones do.
  bool has_own_units() const {
    const auto [least, most] = std::minmax_element(given_.begin(), given_.end());
    return !units_.voices.empty() && *least < *most;
  }

  SolveOptions stage(int max_iterations) const {
    SolveOptions stage = options_;
    stage.iteration = remaining_limits();
    stage.iteration.max_iterations = std::min(stage.iteration.max_iterations, max_iterations);
    return stage;
  }

  /// Least squares, roughly, from the chordal value; nothing where its matrix takes long to factor.
  std::optional<Rotations> least_squares_from_chordal() {
    constexpr double flops_an_edge = 1e5;  // some hundreds of sweeps
    const Components components = connected_components(graph_);
    auto eliminations = grounded_eliminations(graph_, components, num_threads_);
    std::optional<Rotations> R =
        chordal_init(graph_, eliminations, flops_an_edge * graph_.num_edges(), keep_going());
    if (!R) return std::nullopt;
    Solution solution = solve(graph_, rough(), std::move(R));
    took(solution);
    return std::move(solution.rotations);
  }

  /// Least squares, roughly.
  /// @param shares (m,) of the weights that edges have; empty: all 1. They are known to be good
  ///        then, and the start is the tree that they choose, unless another was asked for
  Rotations least_squares(const std::vector<double>& shares, Initialization& init) {
    const std::vector<double> weights = graph_.weights();
    SolveOptions l2 = rough();
    if (!shares.empty()) {
      std::vector<double> less = weights;
      for (std::size_t k = 0; k < shares.size(); ++k) {
        less[k] = std::max(min_weight, less[k] * std::max(least_weight_share, shares[k]));
      }
      graph_.set_weights(less);
      if (options_.init == Initialization::automatic) {
        l2.init = Initialization::maximum_spanning_tree;
      }
    }
    Solution solution = solve(graph_, l2);
    if (!shares.empty()) graph_.set_weights(weights);
    init = solution.init;
    took(solution);
    return std::move(solution.rotations);
  }

  /// Least squares of another graph, as of some of the edges, roughly, from a start near by.
  Rotations least_squares_of(const MeasurementGraph& other, Rotations start) {
    Solution solution = solve(other, rough(), std::move(start));
    took(solution);
    return std::move(solution.rotations);
  }

  /// Least squares and l1, roughly, of some of the edges alone (m,): each has one voice.
  Rotations agreed_by(const std::vector<bool>& chosen) {
    constexpr double l1_scale = 0.01, gain = 1e-3;
    const int limit = ended_ == Status::not_run ? 20 : 0;
    std::vector<Index> edges;
    std::vector<double> some_precision;  // 0 where the loss does not touch an edge
    for (Index k = 0; k < graph_.num_edges(); ++k) {
      if (!chosen[k] && !trusts(k)) continue;
      edges.push_back(k);
      some_precision.push_back(trusts(k) ? 0.0 : 1.0);
    }
    const MeasurementGraph some = some_edges(graph_, edges, std::vector<double>(edges.size(), 1.0));
    Solution start = solve(some, rough());
    took(start);
    IterationOptions iteration = stage(limit).iteration;
    iteration.stop = StopRule::gradient;
    IterationResult result =
        irls(some, start.rotations, {Loss::l1, l1_scale}, some_precision,
             inner_steps(some, options_.method, num_threads_), gain, iteration);
    took(result);
    return std::move(result.rotations);
  }

  /// The loss by reweighting. None is made where the work has ended.
  IterationResult reweighted(const Rotations& R, const RobustLoss& loss, double least_gain,
                             int max_iterations) {
    IterationOptions iteration = stage(ended_ == Status::not_run ? max_iterations : 0).iteration;
    iteration.stop = StopRule::gradient;
    IterationResult result = irls(graph_, R, loss, judged_by(), inner_, least_gain, iteration);
    took(result);
    return result;
  }

  /// A bounded loss by graduated non-convexity.
  Rotations graduated(const Rotations& R, const RobustLoss& loss) {
    if (ended_ != Status::not_run) return R;
    const IterationResult result = gnc(graph_, R, loss, judged_by(), inner_, remaining_limits());
    took(result);
    return result.rotations;
  }

 private:
  /// Of least squares that are but a start.
  SolveOptions rough() const {
    SolveOptions l2 = stage(30);
    l2.certify = false;
    l2.iteration.stop = StopRule::gradient;
    l2.iteration.tolerance = 1e-2;
    // Where outliers make Newton's method wander, a better start would not be better for long.
    if (l2.init == Initialization::automatic) l2.init = Initialization::shortest_path;
    return l2;
  }

  IterationOptions remaining_limits() const {
    IterationResult so_far;
    so_far.iterations = iterations_;
    so_far.seconds = watch_.seconds();
    return remaining(options_.iteration, so_far);
  }

  void took(const IterationResult& result) {
    iterations_ += result.iterations;
    if (ended_ != Status::not_run) return;
    const bool interrupted = options_.iteration.keep_going && !options_.iteration.keep_going();
    if (result.status == Status::stopped || stop_.made() || interrupted) {
      ended_ = Status::stopped;
    } else if (watch_.seconds() >= options_.iteration.time_limit) {
      ended_ = Status::time_limit;
    } else if (iterations_ >= options_.iteration.max_iterations) {
      ended_ = Status::iteration_limit;
    }
  }

  const std::vector<double>& precision_for(Judging judging) const {
    static const std::vector<double> all_alike;
    switch (judging) {
      case Judging::in_own_units:
        break;
      case Judging::freely_in_own_units:
        return free_precision();
      case Judging::evenly:
        return trusting_;
      case Judging::freely_and_evenly:
        return all_alike;
    }
    return precision();
  }
  void note_trust() {
    trusting_.clear();
    if (std::find(precision().begin(), precision().end(), 0.0) == precision().end()) return;
    for (const double p : precision()) trusting_.push_back(p > 0.0 ? 1.0 : 0.0);
  }

  bool judges_freely() const {
    return judging_ == Judging::freely_and_evenly || judging_ == Judging::freely_in_own_units;
  }

  Stopwatch watch_;
  StopRequest stop_;
  MeasurementGraph graph_;
  std::vector<double> given_, x_;
  EdgeUnits units_, units_at_first_;
  Series series_;
  SolveOptions options_;
  int num_threads_;
  int iterations_ = 0;
  Status ended_ = Status::not_run;
  InnerSteps inner_;
  Judging judging_ = Judging::in_own_units;
  std::vector<double> judged_by_;
  std::vector<bool> favoured_;
  std::vector<double> trusting_;  ///< (m,) precisions of 1, but for edges that are trusted
};

}  // namespace rotavg

#pragma GCC diagnostic pop

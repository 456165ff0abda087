#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/gnc.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/irls.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/solve/solve.hpp>

namespace rotavg {

/// The stages of a robust solution, which share the limits, the callback and the watch.
class RobustRun {
 public:
  RobustRun(const MeasurementGraph& graph, const SolveOptions& options)
      : graph_(graph),
        given_(weights_of(graph)),
        options_(options),
        num_threads_(resolve_num_threads(options.iteration.num_threads, graph.num_edges())),
        inner_(inner_steps(graph_, options.method, num_threads_)) {}

  RobustRun(const RobustRun&) = delete;
  RobustRun& operator=(const RobustRun&) = delete;

  const std::vector<double>& given() const { return given_; }
  const std::vector<double>& squared_residuals_at(const Rotations& R) {
    squared_residuals(ResidualQuaternions(graph_, to_quaternions(R), num_threads_), x_);
    return x_;
  }
  int num_threads() const { return num_threads_; }
  int iterations() const { return iterations_; }
  /// How the work has ended before its time; not_run if it may go on.
  Status ended() const { return ended_; }
  double seconds() const { return watch_.seconds(); }
  /// For what is not a stage of its own.
  std::function<bool()> keep_going() const {
    return [this] {
      return watch_.seconds() < options_.iteration.time_limit &&
             (!options_.iteration.keep_going || options_.iteration.keep_going());
    };
  }
  MeasurementGraph& graph() { return graph_; }

  /// Leaves edges out of all that follows, but for a weight that keeps the graph connected.
  void leave_out(const std::vector<bool>& edges) {
    for (std::size_t k = 0; k < edges.size(); ++k) {
      if (edges[k]) given_[k] = std::max(min_weight, least_weight_share * given_[k]);
    }
    graph_.set_weights(given_);
  }

  /// Gives the edges of graph() the weights that a loss gives them at these rotations.
  void hold_weights(const Rotations& R, const RobustLoss& loss) {
    std::vector<double> weights;
    robust_weights(given_, squared_residuals_at(R), loss, num_threads_, weights);
    graph_.set_weights(weights);
  }

  SolveOptions stage(int max_iterations) const {
    SolveOptions stage = options_;
    stage.iteration = remaining_limits();
    stage.iteration.max_iterations = std::min(stage.iteration.max_iterations, max_iterations);
    return stage;
  }

  /// Least squares, roughly.
  Rotations least_squares(Initialization& init) {
    SolveOptions l2 = stage(30);
    l2.certify = false;
    l2.iteration.stop = StopRule::gradient;
    l2.iteration.tolerance = 1e-2;
    Solution solution = solve(graph_, l2);
    init = solution.init;
    took(solution);
    return std::move(solution.rotations);
  }

  IterationResult reweighted(const Rotations& R, const RobustLoss& loss, double least_gain,
                             int max_iterations) {
    IterationOptions iteration = stage(max_iterations).iteration;
    iteration.stop = StopRule::gradient;
    IterationResult result = irls(graph_, R, loss, inner_, least_gain, iteration);
    took(result);
    return result;
  }

  Rotations graduated(const Rotations& R, const RobustLoss& loss) {
    const IterationResult result = gnc(graph_, R, loss, inner_, remaining_limits());
    took(result);
    return result.rotations;
  }

 private:
  IterationOptions remaining_limits() const {
    IterationResult so_far;
    so_far.iterations = iterations_;
    so_far.seconds = watch_.seconds();
    return remaining(options_.iteration, so_far);
  }

  void took(const IterationResult& result) {
    iterations_ += result.iterations;
    if (ended_ != Status::not_run) return;
    const bool asked_to = options_.iteration.keep_going && !options_.iteration.keep_going();
    if (result.status == Status::stopped || asked_to) {
      ended_ = Status::stopped;
    } else if (watch_.seconds() >= options_.iteration.time_limit) {
      ended_ = Status::time_limit;
    } else if (iterations_ >= options_.iteration.max_iterations) {
      ended_ = Status::iteration_limit;
    }
  }

  Stopwatch watch_;
  MeasurementGraph graph_;
  std::vector<double> given_, x_;
  SolveOptions options_;
  int num_threads_;
  int iterations_ = 0;
  Status ended_ = Status::not_run;
  InnerSteps inner_;
};

}  // namespace rotavg

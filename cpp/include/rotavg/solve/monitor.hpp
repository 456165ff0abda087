#pragma once

#include <stdexcept>
#include <utility>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/stopwatch.hpp>

namespace rotavg {

/// What all iterative solvers do after an iteration: measure it, record it, report it, and decide
/// whether to stop.
class Monitor {
 public:
  /// @param R the initial value
  /// @throws std::invalid_argument unless there is one rotation for each node and the options are
  ///         numbers that are not negative
  Monitor(const MeasurementGraph& graph, const Rotations& R, IterationOptions options)
      : options_(std::move(options)),
        num_threads_(resolve_num_threads(options_.num_threads, graph.num_edges())) {
    if (static_cast<Index>(R.size()) != graph.num_nodes()) {
      throw std::invalid_argument("the initial value must have one rotation for each node");
    }
    check(options_);
  }

  int num_threads() const { return num_threads_; }
  double seconds() const { return watch_.seconds(); }

  /// Takes note of what an iteration ended with (first: of the initial value).
  /// @param settled whether more iterations would change nothing, whatever the gradient
  /// @returns whether the solver has to stop
  bool should_stop(double objective, const GradientNorm& gradient, double step,
                   bool settled = false) {
    Progress progress;
    progress.iteration = static_cast<int>(result_.trace.size());
    progress.objective = objective;
    progress.gradient_norm = gradient.absolute;
    progress.relative_gradient = gradient.relative;
    progress.step = step;
    progress.seconds = watch_.seconds();
    result_.trace.push_back(progress);
    result_.status = status_after(progress, settled);
    return result_.status != Status::not_run;
  }

  /// So far; 0 at the initial value.
  int iterations() const { return static_cast<int>(result_.trace.size()) - 1; }
  /// What should_stop was last told.
  double relative_gradient() const { return result_.trace.back().relative_gradient; }

  /// For the middle of a long step; once it is false, should_stop says so, too.
  bool keep_going() const {
    interrupted_ |= options_.keep_going && !options_.keep_going();
    return !interrupted_ && watch_.seconds() < options_.time_limit;
  }

  /// The result, with the rotations that should_stop was last told of.
  IterationResult result(Rotations R) && {
    const Progress& last = result_.trace.back();
    result_.rotations = std::move(R);
    result_.iterations = last.iteration;
    result_.objective = last.objective;
    result_.gradient_norm = last.gradient_norm;
    result_.relative_gradient = last.relative_gradient;
    result_.seconds = watch_.seconds();
    return std::move(result_);
  }

 private:
  Status status_after(const Progress& progress, bool settled) const {
    const bool told_to_go_on = !options_.callback || options_.callback(progress);
    interrupted_ |= options_.keep_going && !options_.keep_going();
    const bool go_on = told_to_go_on && !interrupted_;
    const bool by_step = options_.stop == StopRule::step;
    if (!by_step && progress.relative_gradient <= options_.tolerance) {
      return Status::gradient_converged;
    }
    // Before what the step says: that of an interrupted iteration is short.
    if (!go_on) return Status::stopped;
    if (progress.seconds >= options_.time_limit) return Status::time_limit;
    const bool by_rule = by_step && progress.iteration > 0 && progress.step < options_.tolerance;
    if (by_rule || settled) return Status::step_converged;
    if (progress.iteration >= options_.max_iterations) return Status::iteration_limit;
    return Status::not_run;
  }

  IterationOptions options_;
  int num_threads_;
  Stopwatch watch_;
  IterationResult result_;
  mutable bool interrupted_ = false;
};

}  // namespace rotavg

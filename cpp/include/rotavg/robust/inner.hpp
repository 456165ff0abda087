#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/reweighted_sweep.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/sum.hpp>

namespace rotavg {

/// A few steps that lower the robust objective, in place, of a graph with the given weights and
/// precisions (m,), in whose units the residuals are judged; empty: all 1.
using InnerSteps = std::function<void(const MeasurementGraph&, const RobustLoss&,
                                      const std::vector<double>&, Quaternions&, const Monitor&)>;

/// The weighted graph of a reweighting, and its Laplacian in one order of elimination.
struct WeightedWorkspace {
  WeightedWorkspace(const MeasurementGraph& g, int threads)
      : weighted(g),
        components(connected_components(g)),
        eliminations(grounded_eliminations(g, components, threads)),
        metric(weighted, eliminations) {}
  MeasurementGraph weighted;
  Components components;
  std::vector<Elimination> eliminations;
  LaplacianMetric metric;
};

/// Where the Laplacian is costly: sweeps, and where these have no end, a sweep and a step of
/// Newton's in a metric of older weights, which is factored again whenever there have been twice as
/// many reweightings.
class SeldomFactored {
 public:
  SeldomFactored(InnerSteps sweeps, int num_threads)
      : sweeps_(std::move(sweeps)), num_threads_(num_threads) {}

  void operator()(const MeasurementGraph& g, const RobustLoss& loss,
                  const std::vector<double>& precision, Quaternions& q, const Monitor& monitor) {
    constexpr int patience = 12;        // reweightings
    constexpr double max_flops = 1e10;  // a second or two
    const int iteration = monitor.iterations();
    if (iteration < patience || sweeps_only_) return sweeps_(g, loss, precision, q, monitor);
    if (!workspace_) {
      workspace_ = std::make_shared<WeightedWorkspace>(g, num_threads_);
      sweeps_only_ = workspace_->metric.flops(max_flops) > max_flops;
      if (sweeps_only_) return sweeps_(g, loss, precision, q, monitor);
    }
    reweighted_sweep(g, loss, precision, q, monitor);
    MeasurementGraph& weighted = workspace_->weighted;
    weighted.set_weights(robust_weights(g, q, loss, precision, num_threads_));
    if (iteration < factored_at_ || iteration >= 2 * factored_at_) {
      const auto keep_going = [&monitor] { return monitor.keep_going(); };
      factored_at_ = iteration;
      sweeps_only_ =
          workspace_->metric.factorize(keep_going) == CholeskyOutcome::not_positive_definite;
      if (sweeps_only_ || !monitor.keep_going()) return;
    }
    IterationOptions one;
    one.tolerance = 0.0;
    one.max_iterations = 1;
    one.num_threads = num_threads_;
    one.keep_going = [&monitor] { return monitor.keep_going(); };
    const Rotations R = to_rotations(q);
    ResidualQuaternions residuals(weighted, q, num_threads_);
    q = to_quaternions(newton_iteration(weighted, R, Quaternions(q), residuals, workspace_->metric,
                                        Monitor(weighted, R, one))
                           .rotations);
  }

 private:
  InnerSteps sweeps_;
  int num_threads_;
  std::shared_ptr<WeightedWorkspace> workspace_;  // made when it is first needed
  int factored_at_ = 0;
  bool sweeps_only_ = false;
};

/// The steps of one reweighting: few, since the weights are not final.
///
/// - bcd: two sweeps, whose weights are the newest at every node. sum: two steps.
/// - newton: a sweep and one step, which factors the weighted Laplacian anew in the old order of
///   elimination.
/// - automatic: newton where the Laplacian factors quickly: in the time of some ten sweeps, or a
///   moment, if the graph is sparse, and else in that of the sweeps which it replaces. Cameras
///   along a street or a ring have such Laplacians, whatever their number of neighbours, and on
///   their graphs sweeps are so slow that little is gained by each long before the end. On others,
///   bcd, and SeldomFactored where that has no end.
inline InnerSteps inner_steps(const MeasurementGraph& graph, Method method, int num_threads) {
  constexpr double sparse_degree = 20.0;
  constexpr double flops_of_sweeps = 400.0;  // for an edge, about, in two reweighted sweeps
  const double degree = 2.0 * graph.num_edges() / std::max<Index>(graph.num_nodes(), 1);
  const double max_flops = degree > sparse_degree
                               ? flops_of_sweeps * graph.num_edges()
                               : std::max(2e8, 5.0 * flops_of_sweeps * graph.num_edges());
  const auto sweeps = [](const MeasurementGraph& g, const RobustLoss& loss,
                         const std::vector<double>& precision, Quaternions& q,
                         const Monitor& monitor) {
    for (int k = 0; k < 2 && monitor.keep_going(); ++k) {
      reweighted_sweep(g, loss, precision, q, monitor);
    }
  };
  if (method == Method::bcd) return sweeps;
  // A factor holds at least one entry for an edge, and takes at least the square of these over n.
  const bool dense = 0.5 * degree * graph.num_edges() > max_flops;
  if (method == Method::automatic && dense) return SeldomFactored(sweeps, num_threads);

  const auto workspace = std::make_shared<WeightedWorkspace>(graph, num_threads);
  if (method == Method::automatic && workspace->metric.flops(max_flops) > max_flops) {
    return SeldomFactored(sweeps, num_threads);
  }
  IterationOptions options;
  options.tolerance = 0.0;
  options.num_threads = num_threads;
  options.max_iterations = method == Method::sum ? 2 : 1;
  return [=](const MeasurementGraph& g, const RobustLoss& loss,
             const std::vector<double>& precision, Quaternions& q, const Monitor& monitor) {
    IterationOptions limits = options;
    limits.keep_going = [&monitor] { return monitor.keep_going(); };
    if (method != Method::sum) reweighted_sweep(g, loss, precision, q, monitor);
    MeasurementGraph& weighted = workspace->weighted;
    weighted.set_weights(robust_weights(g, q, loss, precision, num_threads));
    const Rotations R = to_rotations(q);
    q = to_quaternions(method == Method::sum
                           ? sum(weighted, R, limits).rotations
                           : newton(weighted, R, workspace->metric, limits).rotations);
  };
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/degree_metric.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/reweighted_sweep.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/sum.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A few steps that lower the robust objective, in place, from residuals at the rotations to
/// residuals at where they ended.
using InnerSteps = std::function<void(RobustResiduals&, Quaternions&, const Monitor&)>;

/// Two sweeps, each edge with the newest weight at every node.
inline void two_sweeps(RobustResiduals& residuals, Quaternions& q, const Monitor& monitor) {
  for (int k = 0; k < 2 && monitor.keep_going(); ++k) reweighted_sweep(residuals, q, monitor);
  residuals.update(q);
}

/// One step R_i <- exp(w_i) R_i with w = -(4 L)^-1 gradient, L the Laplacian with the weights of
/// the present residuals, in place: nearly Newton's, as weights are small where residuals are not.
/// It is halved until the robust objective does not rise.
inline void laplacian_step(RobustResiduals& residuals, LaplacianMetric& metric, Quaternions& q,
                           const Monitor& monitor) {
  constexpr int max_halvings = 10;
  const MeasurementGraph& graph = residuals.graph();
  const int num_threads = residuals.num_threads();
  const auto keep_going = [&monitor] { return monitor.keep_going(); };
  if (metric.factorize(residuals.weights(), keep_going) != CholeskyOutcome::positive_definite) {
    return two_sweeps(residuals, q, monitor);
  }
  NodeVectors g(graph.num_nodes(), 3), w;
  parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
    const Vector3 g_i = residuals.gradient(i);
    for (int k = 0; k < 3; ++k) g(i, k) = -g_i(k);
  });
  metric.apply(g, w);
  const double enough = residuals.objective() + objective_rounding(graph, residuals.objective());
  Quaternions next(q);
  double t = 1.0;
  for (int k = 0; k < max_halvings; ++k, t *= 0.5) {
    parallel_for(graph.num_nodes(), num_threads, [&](Index i) {
      if (graph.row(i).size() > 0) next[i] = turned(q[i], t * row_of(w, i));
    });
    residuals.update(next);
    if (residuals.objective() <= enough) return std::swap(q, next);
  }
  residuals.update(q);
}

/// A graph's Laplacian in one order of elimination.
struct LaplacianWorkspace {
  LaplacianWorkspace(const MeasurementGraph& graph, int threads)
      : components(connected_components(graph)),
        eliminations(grounded_eliminations(graph, components, threads)),
        metric(graph, eliminations) {}
  LaplacianWorkspace(const LaplacianWorkspace&) = delete;
  LaplacianWorkspace& operator=(const LaplacianWorkspace&) = delete;
  Components components;
  std::vector<Elimination> eliminations;
  LaplacianMetric metric;
};

/// Where the Laplacian is costly: sweeps, and where these have no end, a sweep and a step of
/// Newton's. Its metric is the Laplacian of older weights, factored where as many sweeps have been
/// made as take its time, and again whenever there have been twice as many reweightings, of this
/// start and those before; where that is too large, the degrees.
class SeldomFactored {
 public:
  /// @param sweep_flops operations in the time of two reweighted sweeps
  /// @param max_flops that a factor may take: half a minute, and a gigabyte or two
  SeldomFactored(double sweep_flops, int num_threads, double max_flops = 3e11)
      : sweep_flops_(sweep_flops), max_flops_(max_flops), num_threads_(num_threads) {}

  void operator()(RobustResiduals& residuals, Quaternions& q, const Monitor& monitor) {
    constexpr int patience = 12;  // reweightings
    const int iteration = iterations_++;
    if (iteration < patience) return two_sweeps(residuals, q, monitor);
    if (!workspace_) {
      workspace_ = std::make_shared<LaplacianWorkspace>(residuals.graph(), num_threads_);
      weighted_ = std::make_shared<MeasurementGraph>(residuals.graph());
      flops_ = workspace_->metric.flops(max_flops_);
      too_large_ = flops_ > max_flops_;
    }
    if (!too_large_ && iteration * sweep_flops_ < flops_) return two_sweeps(residuals, q, monitor);
    reweighted_sweep(residuals, q, monitor);
    residuals.update(q);
    MeasurementGraph& weighted = *weighted_;
    weighted.set_weights(residuals.weights());
    if (!too_large_ && iteration >= 2 * factored_at_) {
      const auto keep_going = [&monitor] { return monitor.keep_going(); };
      factored_at_ = iteration;
      too_large_ = workspace_->metric.factorize(weighted.weights(), keep_going) ==
                   CholeskyOutcome::not_positive_definite;
      if (!monitor.keep_going()) return;
    }
    if (too_large_) {
      DegreeMetric degrees(weighted, num_threads_);
      newton_step(degrees, q, monitor);
    } else {
      newton_step(workspace_->metric, q, monitor);
    }
    residuals.update(q);
  }

 private:
  /// On the weighted problem, in place.
  template <typename Metric>
  void newton_step(Metric& metric, Quaternions& q, const Monitor& monitor) const {
    IterationOptions one;
    one.tolerance = 0.0;
    one.max_iterations = 1;
    one.num_threads = num_threads_;
    one.keep_going = [&monitor] { return monitor.keep_going(); };
    const Rotations R = to_rotations(q);
    ResidualQuaternions least_squares(*weighted_, q, num_threads_);
    q = to_quaternions(newton_iteration(*weighted_, R, Quaternions(q), least_squares, metric,
                                        Monitor(*weighted_, R, one))
                           .rotations);
  }

  double sweep_flops_, max_flops_, flops_ = 0.0;
  int num_threads_;
  std::shared_ptr<LaplacianWorkspace> workspace_;  // these are made when they are first needed
  std::shared_ptr<MeasurementGraph> weighted_;
  int iterations_ = 0, factored_at_ = 0;  // over all starts
  bool too_large_ = false;
};

/// Two steps of the paper's parallel algorithm on the weighted problem.
inline void two_sum_steps(RobustResiduals& residuals, Quaternions& q, const Monitor& monitor) {
  IterationOptions limits;
  limits.tolerance = 0.0;
  limits.num_threads = residuals.num_threads();
  limits.max_iterations = 2;
  limits.keep_going = [&monitor] { return monitor.keep_going(); };
  MeasurementGraph weighted = residuals.graph();
  weighted.set_weights(residuals.weights());
  q = to_quaternions(sum(weighted, to_rotations(q), limits).rotations);
  residuals.update(q);
}

/// The steps of one reweighting: few, since the weights are not final.
///
/// - bcd: two sweeps, whose weights are the newest at every node. sum: two steps.
/// - newton: a sweep and one laplacian_step(), which factors anew in the old order of elimination.
/// - automatic: newton where the Laplacian factors quickly: in the time of some ten sweeps, or a
///   moment, if the graph is sparse, and else in that of the sweeps which it replaces. Cameras
///   along a street or a ring have such Laplacians, whatever their number of neighbours, and on
///   their graphs sweeps are so slow that little is gained by each long before the end. On others,
///   bcd, and SeldomFactored where that has no end.
///
/// @param graph that the steps will be taken on; must outlive them
inline InnerSteps inner_steps(const MeasurementGraph& graph, Method method, int num_threads) {
  constexpr double sparse_degree = 20.0;
  const double sweep_flops = 400.0 * graph.num_edges();  // about, in two reweighted sweeps
  const double degree = 2.0 * graph.num_edges() / std::max<Index>(graph.num_nodes(), 1);
  const double max_flops = degree > sparse_degree ? sweep_flops : std::max(2e8, 5.0 * sweep_flops);
  if (method == Method::bcd) return two_sweeps;
  if (method == Method::sum) return two_sum_steps;
  // A factor holds at least one entry for an edge, and takes at least the square of these over n.
  const bool dense = 0.5 * degree * graph.num_edges() > max_flops;
  if (method == Method::automatic && dense) return SeldomFactored(sweep_flops, num_threads);

  const auto workspace = std::make_shared<LaplacianWorkspace>(graph, num_threads);
  if (method == Method::automatic && workspace->metric.flops(max_flops) > max_flops) {
    return SeldomFactored(sweep_flops, num_threads);
  }
  return [=](RobustResiduals& residuals, Quaternions& q, const Monitor& monitor) {
    reweighted_sweep(residuals, q, monitor);
    residuals.update(q);
    if (monitor.keep_going()) laplacian_step(residuals, workspace->metric, q, monitor);
  };
}

}  // namespace rotavg

#pragma GCC diagnostic pop

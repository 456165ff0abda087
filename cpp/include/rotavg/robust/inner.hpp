#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
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

/// Where the Laplacian is costly: sweeps at first. After a dozen reweightings, counted over all
/// starts of a call, as sweeps may have no end, a sweep and a step of Newton's. Its metric is the
/// Laplacian of older weights, factored where as many sweeps have been made as take its time, and
/// again whenever there have been twice as many reweightings; where that is too large, or singular
/// to rounding, the degrees.
class SeldomFactored {
 public:
  /// @param sweep_flops operations in the time of two reweighted sweeps
  /// @param max_flops that a factor may take: half a minute, and a gigabyte or two
  SeldomFactored(double sweep_flops, int num_threads, double max_flops = 3e11)
      : sweep_flops_(sweep_flops),
        max_flops_(max_flops),
        num_threads_(num_threads),
        state_(std::make_shared<State>()) {}

  void operator()(RobustResiduals& residuals, Quaternions& q, const Monitor& monitor) const {
    constexpr int patience = 12;  // reweightings
    State& state = *state_;
    const int iteration = state.iterations++;
    if (iteration < patience) return two_sweeps(residuals, q, monitor);
    if (state.metric == Metric::undecided) decide(residuals.graph());
    if (state.metric == Metric::laplacian && iteration * sweep_flops_ < state.flops) {
      return two_sweeps(residuals, q, monitor);
    }
    reweighted_sweep(residuals, q, monitor);
    residuals.update(q);
    state.weighted->set_weights(residuals.weights());
    if (state.metric == Metric::laplacian && iteration >= 2 * state.factored_at) {
      const auto keep_going = [&monitor] { return monitor.keep_going(); };
      state.factored_at = iteration;
      const CholeskyOutcome outcome =
          state.workspace->metric.factorize(state.weighted->weights(), keep_going);
      if (outcome == CholeskyOutcome::not_positive_definite) use_degrees();
    }
    if (!monitor.keep_going()) return;
    if (state.metric == Metric::laplacian) {
      newton_step(state.workspace->metric, q, monitor, few_steps);
    } else {
      DegreeMetric degrees(*state.weighted, num_threads_);
      newton_step(degrees, q, monitor, many_steps);
    }
    residuals.update(q);
  }

 private:
  enum class Metric { undecided, laplacian, degrees };

  struct State {
    Metric metric = Metric::undecided;
    int iterations = 0, factored_at = 0;
    double flops = 0.0;  ///< of a factor
    std::unique_ptr<LaplacianWorkspace> workspace;
    std::optional<MeasurementGraph> weighted;
  };

  /// Of conjugate gradients. In the metric of the degrees the number of steps grows like the root
  /// of the condition number: a thousand do where it is 1e5 or so, and cost as much as some
  /// hundred sweeps, which would not have got far.
  static constexpr int few_steps = 50, many_steps = 1000;

  void decide(const MeasurementGraph& graph) const {
    State& state = *state_;
    state.weighted = graph;
    state.workspace = std::make_unique<LaplacianWorkspace>(graph, num_threads_);
    state.flops = state.workspace->metric.flops(max_flops_);
    state.metric = Metric::laplacian;
    if (state.flops > max_flops_) use_degrees();
  }
  void use_degrees() const {
    state_->metric = Metric::degrees;
    state_->workspace.reset();
  }

  /// On the weighted problem, in place.
  template <typename AnyMetric>
  void newton_step(AnyMetric& metric, Quaternions& q, const Monitor& monitor,
                   int max_cg_steps) const {
    const MeasurementGraph& weighted = *state_->weighted;
    IterationOptions one;
    one.tolerance = 0.0;
    one.max_iterations = 1;
    one.num_threads = num_threads_;
    one.keep_going = [&monitor] { return monitor.keep_going(); };
    const Rotations R = to_rotations(q);
    ResidualQuaternions least_squares(weighted, q, num_threads_);
    q = to_quaternions(newton_iteration(weighted, R, Quaternions(q), least_squares, metric,
                                        Monitor(weighted, R, one), max_cg_steps)
                           .rotations);
  }

  double sweep_flops_, max_flops_;
  int num_threads_;
  std::shared_ptr<State> state_;  ///< as InnerSteps may be copied
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

#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/robust/irls.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/sum.hpp>

namespace rotavg {

/// The steps between two changes of the weights: few, since the weights are not final.
///
/// - bcd: two sweeps. sum: two steps.
/// - newton: one step, which factors the weighted Laplacian anew in the old order of elimination.
/// - automatic: newton on sparse graphs whose Laplacian factors quickly, after a sweep; else bcd.
///
/// @param graph whose weights will change; must outlive the result
inline InnerSteps inner_steps(const MeasurementGraph& graph, Method method, int num_threads) {
  constexpr double sparse_degree = 20.0;
  const double max_flops = std::max(2e8, 2e3 * graph.num_edges());  // some ten sweeps, or a moment
  const auto sweeps = [](const MeasurementGraph& g, Quaternions& q, const Monitor& monitor) {
    for (int k = 0; k < 2 && monitor.keep_going(); ++k) bcd_sweep(g, q, monitor);
  };
  if (method == Method::bcd) return sweeps;

  IterationOptions options;
  options.tolerance = 0.0;
  options.num_threads = num_threads;
  if (method == Method::sum) {
    options.max_iterations = 2;
    return [options](const MeasurementGraph& g, Quaternions& q, const Monitor& monitor) mutable {
      options.keep_going = [&monitor] { return monitor.keep_going(); };
      q = to_quaternions(sum(g, to_rotations(q), options).rotations);
    };
  }

  struct Workspace {
    explicit Workspace(const MeasurementGraph& g)
        : components(connected_components(g)),
          eliminations(grounded_eliminations(g, components)),
          metric(g, eliminations) {}
    Components components;
    std::vector<Elimination> eliminations;
    LaplacianMetric metric;
  };
  const double degree = 2.0 * graph.num_edges() / std::max<Index>(graph.num_nodes(), 1);
  if (method == Method::automatic && degree > sparse_degree) return sweeps;
  const auto workspace = std::make_shared<Workspace>(graph);
  if (method == Method::automatic && workspace->metric.flops(max_flops) > max_flops) return sweeps;
  options.max_iterations = 1;
  return [options, workspace](const MeasurementGraph& g, Quaternions& q,
                              const Monitor& monitor) mutable {
    options.keep_going = [&monitor] { return monitor.keep_going(); };
    bcd_sweep(g, q, monitor);
    q = to_quaternions(newton(g, to_rotations(q), workspace->metric, options).rotations);
  };
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cstddef>
#include <random>
#include <utility>
#include <vector>

#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/rig_estimate.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/solve/shared_rotations.hpp>
#include <rotavg/solve/solve_with_priors_impl.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Gives a problem the robust weights that a solution ended with.
inline void take_weights(const RobustSolution& solution, GroundedGraph& problem) {
  if (!solution.edge_weights.empty()) problem.set_weights(solution.edge_weights);
  if (solution.absolute.weights.empty() && solution.gravity.weights.empty()) return;
  std::vector<double> absolute = solution.absolute.weights, gravity = solution.gravity.weights;
  if (absolute.empty()) {
    for (const auto& p : problem.priors().absolute) absolute.push_back(p.weight);
  }
  if (gravity.empty()) {
    for (const auto& p : problem.priors().gravity) gravity.push_back(p.weight);
  }
  problem.set_prior_weights(absolute, gravity);
}

/// What rides in `images`, where images of unknown sensors are variables, on the variables of
/// `held`, where they ride on their frames with C.
inline SharedRiding ride_on_shared(const RigLayout& rigs, const GroundedGraph& images,
                                   const GroundedGraph& held, const Rotations& C) {
  const Index bodies = images.riding().num_variables;
  SharedRiding shared;
  shared.riding = Riding::alone(bodies);
  shared.riding.num_variables = held.riding().num_variables;
  std::fill(shared.riding.variable.begin(), shared.riding.variable.end(), 0);
  shared.shared.assign(static_cast<std::size_t>(bodies), -1);
  shared.num_shared = rigs.num_sensors();
  for (Index i = 0; i < images.given().num_nodes(); ++i) {
    const Index b = images.riding().variable[i], s = rigs.sensor_of()[i];
    if (images.has_world() && b == 0) continue;  // rides on the world in both
    const bool estimated = s >= 0 && rigs.is_estimated(s);
    shared.riding.variable[b] = held.riding().variable[i];
    // Q_b C_i(images) = Q_v C_i(held): K = C_i(held) C_i(images)^T, less the shared rotation.
    const Matrix3 inner = estimated ? C[s] : images.riding().variable_from_node[i];
    shared.riding.variable_from_node[b] =
        nearest_rotation(held.riding().variable_from_node[i] * inner.transpose());
    if (estimated) shared.shared[b] = s;
  }
  return shared;
}

/// Frames and sensors together, by least squares with the weights that a solution ended with.
/// @param images where those of unknown sensors are nodes of their own; receives the weights
/// @returns the largest turn of a sensor, radians
inline double refine_sensors(const MeasurementGraph& graph, const RigLayout& layout,
                             const Priors& priors, const RobustSolution& solution,
                             GroundedGraph& images, const IterationOptions& options,
                             RigEstimate& estimate) {
  const Stopwatch watch;
  Rotations& C = estimate.frame_from_sensor;
  GroundedGraph held(graph, layout.held(graph, priors, C));
  take_weights(solution, images);
  take_weights(solution, held);
  const SharedRiding shared = ride_on_shared(layout, images, held, C);
  SharedResult found = refine_shared(images.graph(), shared, held.graph(),
                                     held.variables_from(estimate.rotations), C, options);
  // Where hardly anything is left over, sensors that are right to the tolerance alone would keep
  // the frames from being proved, which then are to fit to rounding.
  constexpr double exact = 1e-14, to_rounding = 1e-14;
  constexpr int few = 3;  // steps
  const Rotations R = images.nodes_from(shared.nodes_from(found.variables, found.shared));
  if (found.converged && found.relative_gradient > to_rounding &&
      objective(images, R) <= exact * images.graph().total_weight()) {
    IterationOptions nearer = options;
    nearer.tolerance = to_rounding;
    nearer.time_limit = std::max(0.0, options.time_limit - watch.seconds());
    const int before = found.iterations;
    found = refine_shared(images.graph(), shared, held.graph(), std::move(found.variables),
                          std::move(found.shared), nearer, few);
    found.converged = found.relative_gradient <= options.tolerance;
    found.iterations += before;
  }
  double change = 0.0;
  for (std::size_t s = 0; s < C.size(); ++s) {
    if (!layout.is_estimated(static_cast<Index>(s))) continue;
    change = std::max(change, angle_between(C[s], found.shared[s]));
    C[s] = found.shared[s];
    estimate.determined[s] = found.determined[s];
  }
  estimate.converged = found.converged;
  estimate.iterations += found.iterations;
  estimate.relative_gradient = found.relative_gradient;
  estimate.rotations = images.nodes_from(shared.nodes_from(found.variables, C));
  return change;
}

/// Where only the rigs join parts of the graph, where frames and sensors begin decides where they
/// end: from the sensors of the estimate and from random ones, until the least objective was met
/// five times, or is so near to that of the images alone that no start can gain much.
/// @param solution of the images alone, whose weights count
/// @param images as refine_sensors()
/// @param left returns the options of what time is left
template <typename Options>
void start_across_parts(const MeasurementGraph& graph, const RigLayout& layout,
                        const Priors& priors, const RobustSolution& solution, GroundedGraph& images,
                        Options&& left, RigEstimate& estimate) {
  // Many frames tell by how they turn, and cost more.
  const int max_starts = static_cast<int>(std::clamp<Index>(300 / layout.num_frames(), 1, 50));
  constexpr int enough = 5;
  constexpr double same = 1e-6, exact = 1e-14, near = 1.5;
  take_weights(solution, images);
  const double alone = objective(images, solution.rotations);
  std::mt19937_64 generator(0x5eed);
  const RigEstimate given = estimate;
  double least = 0.0;
  for (int k = 0, met = 0; k < max_starts && met < enough; ++k) {
    RigEstimate tried = given;
    for (std::size_t s = 0; s < tried.frame_from_sensor.size() && k > 0; ++s) {
      if (!layout.is_estimated(static_cast<Index>(s))) continue;
      tried.frame_from_sensor[s] = random_rotation(generator);
    }
    GroundedGraph held(graph, layout.held(graph, priors, tried.frame_from_sensor));
    take_weights(solution, held);
    SolveOptions rough = left();
    rough.iteration.tolerance = std::max(rough.iteration.tolerance, 1e-3);
    tried.rotations = solve(held, rough).rotations;
    refine_sensors(graph, layout, priors, solution, images, left().iteration, tried);
    const double f = objective(images, tried.rotations);
    const IterationOptions limits = left().iteration;
    const bool interrupted = limits.keep_going && !limits.keep_going();
    if (k > 0 && interrupted) break;
    const double none = exact * images.graph().total_weight();
    if (k == 0 || f < (1.0 - same) * least - none) {
      estimate = std::move(tried);
      least = f;
      met = 1;
    } else if (f <= (1.0 + same) * least + none) {
      ++met;
    }
    if (least <= near * alone + none || interrupted || limits.time_limit <= 0.0) break;
  }
}

}  // namespace detail

}  // namespace rotavg

#pragma GCC diagnostic pop

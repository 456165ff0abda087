#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/init/rig_start.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/solve_rigs.hpp>
#include <rotavg/robust/solve_robust_with_priors_impl.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/solve/shared_rotations.hpp>
#include <rotavg/solve/solve_with_priors_impl.hpp>
#include <rotavg/solve/stop_request.hpp>
#include <rotavg/solve/stopwatch.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// solve() or solve_robust().
inline RobustSolution solve_either(const GroundedGraph& problem, const SolveOptions& options,
                                   const std::optional<RobustOptions>& robust,
                                   std::optional<Rotations> start = std::nullopt) {
  if (robust) return solve_robust(problem, options, *robust, std::move(start));
  RobustSolution solution;
  static_cast<Solution&>(solution) = solve(problem, options, std::move(start));
  return solution;
}

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

/// The robust weights (m,) of the given measurements at other rotations (n,), in the units and at
/// the scale that a solution ended with.
inline std::vector<double> reweighed(const MeasurementGraph& given, const RobustSolution& solution,
                                     const Rotations& R) {
  std::vector<double> weights = solution.edge_weights;
  for (Index k = 0; k < given.num_edges(); ++k) {
    const EdgeVerdict verdict = solution.verdicts.edges[k];
    if (verdict == EdgeVerdict::trusted || verdict == EdgeVerdict::excluded ||
        verdict == EdgeVerdict::cycle_check) {
      continue;
    }
    const Edge& e = given.edges()[k];
    const double x = 0.5 * residual(e, R).squaredNorm(), scale = solution.edge_scales[k];
    const double share = weight_share(solution.loss, x, 1.0 / (scale * scale));
    weights[k] = std::max(min_weight, std::max(least_weight_share, share) * e.weight);
  }
  return weights;
}

/// Labels (n,) of the parts of the images that say something of one another: those that gravity
/// alone holds have each a heading of their own.
inline std::vector<Index> parts_of_images(const GroundedGraph& images,
                                          const Components& components) {
  std::vector<Index> label = components.label;
  const auto parts = static_cast<Index>(components.nodes.size());
  for (std::size_t i = 0; i < label.size(); ++i) {
    const Index heading = images.free_heading()[images.riding().variable[i]];
    if (heading >= 0) label[i] = parts + heading;
  }
  return label;
}

/// The rotations of all nodes where the frames are the medians of what their images say.
inline Rotations frames_from_images(const RigLayout& rigs, const Rotations& C, Rotations R) {
  std::vector<Rotations> samples(static_cast<std::size_t>(rigs.num_frames()));
  for (std::size_t i = 0; i < R.size(); ++i) {
    if (rigs.frame_of()[i] < 0) continue;
    samples[rigs.frame_of()[i]].push_back(R[i] * C[rigs.sensor_of()[i]].transpose());
  }
  Rotations frames;
  for (const Rotations& of_frame : samples) frames.push_back(median_rotation(of_frame));
  for (std::size_t i = 0; i < R.size(); ++i) {
    if (rigs.frame_of()[i] >= 0) R[i] = frames[rigs.frame_of()[i]] * C[rigs.sensor_of()[i]];
  }
  return R;
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

ROTAVG_INLINE RigEstimate estimate_rigs(const MeasurementGraph& graph, const Rigs& rigs,
                                        const Priors& priors, const SolveOptions& options,
                                        const std::optional<RobustOptions>& robust,
                                        std::optional<Rotations> start) {
  check(options);
  constexpr int max_rounds = 30;
  constexpr double settled = 1e-6;  // radians
  const Stopwatch watch;
  const RigLayout layout(graph, rigs);
  RigEstimate estimate;
  estimate.sensors = layout.sensors();
  estimate.origin = layout.origin();
  estimate.determined.assign(estimate.sensors.size(), true);
  estimate.frame_from_sensor = layout.rotations();
  if (!layout.any_estimated()) {
    estimate.converged = true;
    return estimate;
  }
  const NodeRows rows(graph.nodes());
  for (const FixedRotation& p : priors.fixed) {
    const Index row = rows.find(p.node);
    if (row >= 0 && layout.sensor_of()[row] >= 0 && layout.is_estimated(layout.sensor_of()[row])) {
      throw InvalidPrior(PriorKind::fixed, p.node,
                         "is of an image whose sensor has no known rotation in its rig");
    }
  }
  SolveOptions rough = options;
  rough.certify = false;
  rough.iteration.tolerance = std::max(options.iteration.tolerance, 1e-6);
  rough.iteration.callback = nullptr;
  const auto left = [&] {
    rough.iteration.time_limit = std::max(0.0, options.iteration.time_limit - watch.seconds());
    return rough;
  };

  // 1. and 2.
  Rotations& C = estimate.frame_from_sensor;
  GroundedGraph images(graph, layout.without_estimated(graph, priors));
  RobustSolution solution = detail::solve_either(images, left(), robust, std::move(start));
  const std::vector<Index> label = detail::parts_of_images(images, solution.components);
  C = sensors_from_images(layout, solution.rotations, label);

  // 3.
  if (std::all_of(label.begin(), label.end(), [&](Index c) { return c == label.front(); })) {
    estimate.rotations = detail::frames_from_images(layout, C, std::move(solution.rotations));
  } else {  // only the rigs hold the parts together
    detail::start_across_parts(graph, layout, priors, solution, images, left, estimate);
    if (robust) {
      const GroundedGraph held(graph, layout.held(graph, priors, C));
      solution = detail::solve_either(held, left(), robust);
      estimate.rotations = std::move(solution.rotations);
    }
  }
  for (int round = 0; round < max_rounds; ++round) {
    IterationOptions iteration = left().iteration;
    iteration.tolerance = options.iteration.tolerance;
    const double change =
        detail::refine_sensors(graph, layout, priors, solution, images, iteration, estimate);
    if (!robust || change <= settled || watch.seconds() >= options.iteration.time_limit) break;
    solution.edge_weights = detail::reweighed(graph, solution, estimate.rotations);
  }
  estimate.seconds = watch.seconds();
  return estimate;
}

ROTAVG_INLINE RigSolution solve_rigs(const MeasurementGraph& graph, const Rigs& rigs,
                                     const Priors& priors, const SolveOptions& options,
                                     const std::optional<RobustOptions>& robust,
                                     std::optional<Rotations> start) {
  check(options);
  const Stopwatch watch;
  const StopRequest stop;
  RigSolution solution;
  solution.rigs = estimate_rigs(graph, rigs, priors, options, robust, start);
  if (!solution.rigs.rotations.empty()) start = solution.rigs.rotations;
  SolveOptions rest = stop.heeding(options);
  const auto left = [&] {
    rest.iteration.time_limit = std::max(0.0, options.iteration.time_limit - watch.seconds());
    return rest;
  };
  const RigLayout layout(graph, rigs);
  GroundedGraph images(graph, layout.without_estimated(graph, priors));
  // A robust solve finds a scale and weights anew: sensors and weights have to agree in the end.
  constexpr int max_rounds = 10;
  constexpr double settled = 1e-5;  // radians
  for (int round = 0;; ++round) {
    const GroundedGraph held(graph, solution.rigs.held(graph, rigs, priors));
    static_cast<RobustSolution&>(solution) = detail::solve_either(held, left(), robust, start);
    if (!robust || !layout.any_estimated() || solution.status == Status::stopped || stop.made()) {
      break;
    }
    solution.rigs.rotations = solution.rotations;
    RigEstimate refined = solution.rigs;
    const double change =
        detail::refine_sensors(graph, layout, priors, solution, images, left().iteration, refined);
    // Of these weights with these sensors: as near as the sensors have come to rest.
    solution.rigs.relative_gradient = std::max(refined.relative_gradient, change);
    if (change <= settled) break;
    solution.rigs.converged = false;  // if this is the end
    if (round == max_rounds || left().iteration.time_limit <= 0.0) break;
    start = refined.rotations;
    solution.rigs = std::move(refined);
  }
  const bool more = layout.any_estimated() && (robust || options.certify);
  if (stop.made() && more) solution.status = Status::stopped;
  if (options.certify && layout.any_estimated() && solution.status != Status::stopped) {
    detail::take_weights(solution, images);
    rest.iteration.callback = nullptr;
    const Solution relaxed = solve(images, left(), solution.rotations);
    if (relaxed.certificate.verdict != Verdict::not_run) {
      solution.rigs.lower_bound = std::max(0.0, relaxed.objective - relaxed.certificate.gap);
    }
    solution.timings.certify +=
        relaxed.timings.init + relaxed.timings.solve + relaxed.timings.certify;
  }
  solution.timings.init += solution.rigs.seconds;
  return solution;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

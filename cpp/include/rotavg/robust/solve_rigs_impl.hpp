#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/init/rig_start.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/refine_sensors_impl.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/solve_rigs.hpp>
#include <rotavg/robust/solve_robust_with_priors_impl.hpp>
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

}  // namespace detail

ROTAVG_INLINE RigEstimate estimate_rigs(const MeasurementGraph& graph, const Rigs& rigs,
                                        const Priors& priors, const SolveOptions& options,
                                        const std::optional<RobustOptions>& robust,
                                        std::optional<Rotations> start) {
  check(options);
  constexpr int max_rounds = 30;
  constexpr double settled = 1e-5;  // radians
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
  std::optional<RobustOptions> from_estimate = robust;
  if (robust) from_estimate->continues = layout.any_estimated();
  for (int round = 0;; ++round) {
    const GroundedGraph held(graph, solution.rigs.held(graph, rigs, priors));
    static_cast<RobustSolution&>(solution) =
        detail::solve_either(held, left(), from_estimate, start);
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

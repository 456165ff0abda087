#pragma once

#include <algorithm>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/robust/consensus.hpp>
#include <rotavg/robust/cycles.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/solve/solve.hpp>

namespace rotavg {

/// How many times the noise the scale of a loss is, by measurement (docs/robust.md): what does well
/// on photographs and in simulations, and loses little where the noise is Gaussian.
///
/// @param freedom (m - n + components) / m. Where it is small, as on trajectories, rotations can be
///        bent to meet many measurements exactly, and a sharply bent loss rewards that.
inline double default_scale(Loss loss, double freedom) {
  constexpr double most = 3.0;
  const double slack = 1.0 / std::max(freedom * freedom, 1e-6);
  switch (loss) {
    case Loss::l1:
      return 0.1;
    case Loss::l_half:
      return std::min(most, 0.3 * slack);
    case Loss::huber:
      return 1.0;
    case Loss::geman_mcclure:
      return 2.0;
    case Loss::tls:
      return 3.0;
    case Loss::cauchy:
    case Loss::l2:
    case Loss::automatic:
      break;
  }
  return std::min(most, 0.4 * slack);
}

namespace detail {

/// In words, for people, hence in degrees.
inline std::string describe(const RobustLoss& loss, int l1_reweightings, Index moved,
                            int reweightings) {
  constexpr double degrees = 57.29577951308232;
  std::ostringstream text;
  text.precision(2);
  text << reweightings << " reweightings at the scale of " << loss.scale * degrees << " deg, after "
       << l1_reweightings << " of l1 and " << moved << (moved == 1 ? " node" : " nodes")
       << " moved by votes";
  return text.str();
}

}  // namespace detail

ROTAVG_INLINE RobustSolution solve_robust(const MeasurementGraph& graph,
                                          const SolveOptions& options, const RobustOptions& robust,
                                          std::optional<Rotations> start) {
  constexpr double l1_scale = 0.01, outlier_noises = 3.0;
  constexpr double l1_gain = 1e-4, loss_gain = 1e-5;
  constexpr int l1_limit = 60, loss_limit = 500;
  if (!(robust.scale >= 0.0) || !(robust.cycle_threshold >= 0.0)) {
    throw std::invalid_argument("a scale or threshold is negative or not a number");
  }
  RobustRun run(graph, options);
  RobustSolution solution;
  const auto go_on = [&] { return run.ended() == Status::not_run; };
  std::vector<bool> refuted;
  if (robust.cycle_threshold > 0.0) {
    for (const CycleEvidence& e : cycle_evidence(graph, robust.cycle_threshold, run.keep_going())) {
      refuted.push_back(e.refuted());
    }
    run.leave_out(refuted);
  }

  // 1.
  Initialization init = Initialization::automatic;
  Rotations R = start ? checked_rotations(graph, std::move(*start)) : run.least_squares(init);
  const IterationResult l1 =
      run.reweighted(R, {Loss::l1, l1_scale}, l1_gain, go_on() ? l1_limit : 0);
  R = l1.rotations;

  // 2. and 3.
  const Index num_cycles =
      graph.num_edges() - graph.num_nodes() + connected_components(graph).size();
  const double freedom = static_cast<double>(num_cycles) / graph.num_edges();
  Consensus consensus = find_consensus(run, graph, num_cycles, std::move(R));
  const double noise = consensus.noise;
  const Index moved = consensus.moved;
  R = std::move(consensus.rotations);

  // 4.
  RobustLoss& loss = solution.loss;
  loss.kind = robust.loss == Loss::automatic ? Loss::cauchy : robust.loss;
  loss.scale = robust.scale > 0.0 ? robust.scale : default_scale(loss.kind, freedom) * noise;
  const double prepared = run.seconds();
  if (go_on()) R = run.graduated(R, loss);
  IterationResult reweighted = run.reweighted(R, loss, loss_gain, go_on() ? loss_limit : 0);
  const double reweighting_seconds = run.seconds() - prepared;

  // 5.
  run.hold_weights(reweighted.rotations, loss);
  Status early = run.ended();
  if (go_on() && reweighted.status == Status::iteration_limit) early = Status::iteration_limit;
  static_cast<Solution&>(solution) =
      solve(run.graph(), run.stage(go_on() ? options.iteration.max_iterations : 0),
            std::move(reweighted.rotations));
  if (early != Status::not_run) solution.status = early;
  solution.init = init;
  solution.iterations += run.iterations();
  solution.trace = std::move(reweighted.trace);
  solution.timings.init += prepared;
  solution.timings.solve += reweighting_seconds;
  solution.reason = detail::describe(loss, l1.iterations, moved, reweighted.iterations) +
                    (solution.reason.empty() ? "" : "; then " + solution.reason);

  const std::vector<double>& x = run.squared_residuals_at(solution.rotations);
  solution.moved_by_votes = moved;
  solution.edge_weights = weights_of(run.graph());
  solution.robust_objective = robust_objective(run.given(), x, loss, run.num_threads());
  solution.noise = noise;
  solution.threshold = outlier_noises * solution.noise;
  if (loss.kind == Loss::tls) solution.threshold = loss.scale;
  if (loss.kind == Loss::l2) solution.threshold = 3.141592653589793;  // believes everything
  solution.verdicts = edge_verdicts(graph, x, solution.threshold, refuted);
  return solution;
}

}  // namespace rotavg

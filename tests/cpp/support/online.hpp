#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/graph/components.hpp>
#include <rotavg/online/online.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/solve.hpp>

namespace rotavg::test {

/// What is in use, as a graph.
inline std::vector<RelativeRotation> used(const Online& online) {
  std::vector<Index> numbers;
  std::vector<RelativeRotation> edges;
  const std::vector<double> weights = online.edge_weights();
  const auto all = online.edges(numbers);
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (!(weights[numbers[k]] > 0.0)) continue;
    edges.push_back(all[k]);
    edges.back().weight = weights[numbers[k]];
  }
  return edges;
}

/// The state is what it says, and the rotations are those that solve() finds.
inline void check_against_solve(const Online& online, double relative = 1e-9) {
  const OnlineState& state = online.state();
  const auto edges = used(online);
  CHECK(state.num_nodes == static_cast<Index>(online.nodes().size()));
  CHECK(state.num_edges == static_cast<Index>(edges.size()));
  const Rotations R = online.rotations();
  if (edges.empty()) {
    CHECK(state.objective == 0.0);
    return;
  }
  const MeasurementGraph graph(edges, online.nodes());
  CHECK(state.num_components == connected_components(graph).size());
  const double f = objective(graph, R);
  const double rounding = objective_rounding(graph, f) + 1e-25 * graph.total_weight();
  CHECK(std::abs(state.objective - f) <= 1e-9 * f + rounding);
  SolveOptions options;
  options.certificate.failure_probability = 0.0;
  const Solution best = solve(graph, options);
  CHECK(f <= best.objective * (1.0 + relative) + 4.0 * rounding);
  // What is proved is true.
  CHECK(f - state.gap <= best.objective + 1e-12 * f + rounding);
  if (best.certificate.verdict == Verdict::proved &&
      best.objective > 1e-12 * graph.total_weight()) {
    INFO("relative gap ", state.relative_gap, " f ", state.objective, " of weight ",
         graph.total_weight(), " refreshed ", state.refreshed, " solved ", state.solved, " nodes ",
         state.num_nodes, " edges ", state.num_edges, " components ", state.num_components);
    CHECK(state.verdict == Verdict::proved);
  }
}

}  // namespace rotavg::test

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <rotavg/graph/parts.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// By how many radians priors are missed.
struct PriorResiduals {
  std::vector<double> absolute;  ///< in the order of the rows of their nodes
  std::vector<double> gravity;   ///< tilts, in the same order
};

/// @param R (n,) world_from_node
inline PriorResiduals prior_residuals(const GroundedGraph& problem, const Rotations& R) {
  const CheckedPriors& priors = problem.priors();
  PriorResiduals residuals;
  for (const CheckedPriors::Rotation& p : priors.absolute) {
    residuals.absolute.push_back(angle_between(R[p.node], p.world_from_node));
  }
  for (const CheckedPriors::Gravity& p : priors.gravity) {
    const double chord = (R[p.node] * p.down - priors.down).norm();
    residuals.gravity.push_back(2.0 * std::asin(std::min(1.0, 0.5 * chord)));
  }
  return residuals;
}

/// What the priors of every given node (n,) add to the objective at R (n,), world_from_node.
inline std::vector<double> prior_costs(const GroundedGraph& problem, const Rotations& R) {
  const CheckedPriors& priors = problem.priors();
  std::vector<double> costs(R.size(), 0.0);
  for (const CheckedPriors::Rotation& p : priors.absolute) {
    costs[p.node] += p.weight * (R[p.node] - p.world_from_node).squaredNorm();
  }
  for (const CheckedPriors::Gravity& p : priors.gravity) {
    costs[p.node] += gravity_cost(R[p.node], p.down, priors.down, p.weight);
  }
  return costs;
}

/// The same of the objective of logarithms: 2 w theta^2 in place of 8 w sin^2(theta / 2), theta the
/// angle by which the prior is missed.
inline std::vector<double> log_prior_costs(const GroundedGraph& problem, const Rotations& R) {
  const CheckedPriors& priors = problem.priors();
  const PriorResiduals missed = prior_residuals(problem, R);
  std::vector<double> costs(R.size(), 0.0);
  for (std::size_t k = 0; k < missed.absolute.size(); ++k) {
    const CheckedPriors::Rotation& p = priors.absolute[k];
    costs[p.node] += 2.0 * p.weight * missed.absolute[k] * missed.absolute[k];
  }
  for (std::size_t k = 0; k < missed.gravity.size(); ++k) {
    const CheckedPriors::Gravity& p = priors.gravity[k];
    costs[p.node] += 2.0 * p.weight * missed.gravity[k] * missed.gravity[k];
  }
  return costs;
}

/// What every edge (m',) of problem.graph() adds to the objective; a pair of gravity, but for its
/// constant, in its first edge.
/// @param R (n,) world_from_node
inline std::vector<double> edge_costs(const GroundedGraph& problem, const Rotations& R) {
  const MeasurementGraph& graph = problem.graph();
  const Rotations Q = problem.variables_from(R);
  const Quaternions q = to_quaternions(Q);
  std::vector<double> costs;
  costs.reserve(graph.edges().size());
  for (const Edge& e : graph.edges()) costs.push_back(e.weight * residual(e, Q).squaredNorm());
  for (const Index first : problem.gravity().first) {
    costs[first] = problem.gravity().cost(residual_quaternion(graph.quaternion_edges()[first], q));
    costs[first + 1] = 0.0;
  }
  return costs;
}

/// The objective of measurements and priors at R (n,), world_from_node, with what nothing can
/// change between nodes of one variable, and without the constant of gravity's edges.
/// @throws std::invalid_argument unless there is one rotation for each node
inline double objective(const GroundedGraph& problem, const Rotations& R) {
  require_one_rotation_each(problem.given(), R);
  const std::vector<double> of_priors = prior_costs(problem, R), of_edges = edge_costs(problem, R);
  std::vector<bool> kept(problem.given().edges().size(), false);
  double sum = 0.0;
  for (std::size_t k = 0; k < problem.kept().size(); ++k) {
    kept[problem.kept()[k]] = true;
    sum += of_edges[k];
  }
  for (Index k = 0; k < problem.given().num_edges(); ++k) {
    const Edge& e = problem.given().edges()[k];
    if (!kept[k]) sum += problem.weights()[k] * residual(e, R).squaredNorm();
  }
  for (const double cost : of_priors) sum += cost;
  return sum;
}

/// Equations less unknowns, if every equation has full rank: the degrees of freedom of the
/// residuals.
/// @param holds (m',) the edges of problem.graph() that count
inline Index degrees_of_freedom(const GroundedGraph& problem, const std::vector<bool>& holds) {
  std::vector<Index> equations(holds.size(), 3);
  for (const Index first : problem.gravity().first) {
    equations[first] = 2;
    equations[first + 1] = 0;
  }
  Index freedom = -3 * problem.graph().num_nodes();
  for (std::size_t k = 0; k < holds.size(); ++k) freedom += holds[k] ? equations[k] : 0;
  Index gauges = 0, headings = 0;  // the world, or a free gauge, in each part
  for (const Index p : parts_joined_by(problem.graph(), holds)) gauges = std::max(gauges, p + 1);
  for (const Index h : problem.find_free_headings(holds)) headings = std::max(headings, h + 1);
  return freedom + 3 * gauges + headings;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

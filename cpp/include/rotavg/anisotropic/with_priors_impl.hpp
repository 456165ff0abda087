#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/certify_impl.hpp>
#include <rotavg/anisotropic/solve_impl.hpp>
#include <rotavg/anisotropic/with_priors.hpp>
#include <rotavg/certify/excess.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/alignment.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/reduction/reduced_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/logarithms.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// 4 v^T H v of an edge, H its precision in the frame of j.
inline double anisotropic_cost(const Matrix3& R_i, const Matrix3& i_from_j, const Matrix3& R_j,
                               const Matrix3& H) {
  const Matrix3 error = transposed_product(product(R_i, i_from_j), R_j);
  const Vector3 v = vector_part(to_quaternion(error).coeffs());
  return std::max(4.0 * dot(v, product(H, v)), 0.0);
}

/// r^T H r of an edge.
inline double log_cost(const Matrix3& R_i, const Matrix3& i_from_j, const Matrix3& R_j,
                       const Matrix3& H) {
  const Vector3 r = log_so3(transposed_product(product(R_i, i_from_j), R_j));
  return std::max(dot(r, product(H, r)), 0.0);
}

/// What absolute priors and gravity cost, node by node: add(node, cost, tr(H)).
template <typename Add>
void add_prior_costs(const GroundedGraph& problem, const GroundedPrecisions& precisions,
                     const Rotations& R, Add&& add) {
  const CheckedPriors& priors = problem.priors();
  for (const auto& p : priors.absolute) {  // H = h I: half the isotropic cost of weight h
    const double h = precisions.prior * p.weight;
    add(p.node, 0.5 * h * (R[p.node] - p.world_from_node).squaredNorm(), 3.0 * h);
  }
  for (const auto& p : priors.gravity) {
    const double h = precisions.prior * p.weight;
    add(p.node, 0.5 * gravity_cost(R[p.node], p.down, priors.down, h), 2.0 * h);
  }
}

/// What is the same whatever the variables are: the edges whose two ends ride on one, and the
/// priors of nodes that ride on the world.
/// @param edge_cost of a measurement: anisotropic_cost or log_cost
/// @param prior_costs (n,) of the nodes, for a weight 1 of the precision 2
template <typename EdgeCost>
double cost_of_what_is_held(const GroundedGraph& problem, const GroundedPrecisions& precisions,
                            const Rotations& R, EdgeCost&& edge_cost,
                            const std::vector<double>& prior_costs) {
  const auto& given = problem.given().edges();
  std::vector<bool> is_kept(given.size(), false);
  for (const Index k : problem.kept()) is_kept[k] = true;
  double sum = 0.0;
  for (std::size_t k = 0; k < given.size(); ++k) {
    const Edge& e = given[k];
    if (is_kept[k]) continue;
    sum += edge_cost(R[e.i], e.i_from_j(), R[e.j], precisions.measurements[k]);
  }
  if (!problem.has_world()) return sum;
  for (std::size_t i = 0; i < prior_costs.size(); ++i) {
    if (problem.riding().variable[i] == 0) sum += 0.5 * precisions.prior * prior_costs[i];
  }
  return sum;
}

/// What every component of the variables costs at R (n,), the edges that are held included, and
/// what a rounding of it may be.
struct ComponentCosts {
  std::vector<double> cost, rounding;
};
inline ComponentCosts costs_of_components(const GroundedGraph& problem,
                                          const GroundedPrecisions& precisions,
                                          const Rotations& R) {
  const auto count = problem.components().nodes.size();
  ComponentCosts costs{std::vector<double>(count, 0.0), std::vector<double>(count, 0.0)};
  std::vector<double> weight(count, 0.0);
  const auto add = [&](Index node, double cost, double trace) {
    const Index c = problem.components().label[problem.riding().variable[node]];
    costs.cost[c] += cost;
    weight[c] += trace;
  };
  for (Index k = 0; k < problem.given().num_edges(); ++k) {
    const Edge& e = problem.given().edges()[k];
    const Matrix3& H = precisions.measurements[k];
    add(e.i, anisotropic_cost(R[e.i], e.i_from_j(), R[e.j], H), H.trace());
  }
  add_prior_costs(problem, precisions, R, add);
  for (std::size_t c = 0; c < count; ++c) {
    costs.rounding[c] = 4.0 * objective_rounding(weight[c], costs.cost[c]);
  }
  return costs;
}

}  // namespace detail

ROTAVG_INLINE AnisotropicGraph anisotropic_graph(const GroundedGraph& problem,
                                                 const GroundedPrecisions& precisions) {
  // The heaviest edge of gravity of every part whose heading is free.
  const auto& edges = problem.graph().edges();
  std::vector<Index> heaviest(static_cast<std::size_t>(problem.num_free_headings()), -1);
  for (const Index k : problem.gravity().first) {
    const Index part = problem.free_heading()[edges[k].i];
    if (part < 0) continue;
    Index& best = heaviest[part];
    if (best < 0 || edges[k].weight > edges[best].weight) best = k;
  }
  std::vector<FreeAxis> free_axes;
  for (const Index k : heaviest) free_axes.push_back({k, problem.gravity().down});
  return {problem.graph(), precisions_of_edges(problem, precisions), std::move(free_axes)};
}

ROTAVG_INLINE Solution solve(const GroundedGraph& problem, const GroundedPrecisions& precisions,
                             const SolveOptions& options, const Rotations& start) {
  const AnisotropicGraph graph = anisotropic_graph(problem, precisions);
  const Rotations R = checked_rotations(problem.given(), start);
  Solution solution = solve(graph, options, problem.variables_from(R));
  solution.rotations = problem.nodes_from(headed(problem, solution.rotations));
  solution.components = components_of_nodes(problem.riding(), problem.components());
  const double held = detail::cost_of_what_is_held(problem, precisions, solution.rotations,
                                                   detail::anisotropic_cost,
                                                   prior_costs(problem, solution.rotations));
  solution.objective += held;
  for (Progress& progress : solution.trace) progress.objective += held;
  return solution;
}

ROTAVG_INLINE IterationResult refine_anisotropic(const GroundedGraph& problem,
                                                 const GroundedPrecisions& precisions,
                                                 const Rotations& start,
                                                 const IterationOptions& options) {
  const std::vector<Matrix3> information = precisions_of_edges(problem, precisions);
  const LogObjective objective(problem.graph(), information, problem.gravity());
  const Rotations R = checked_rotations(problem.given(), start);
  IterationResult result = minimise_logarithms(objective, problem.variables_from(R), options);
  result.rotations = problem.nodes_from(headed(problem, result.rotations));
  const double held =
      detail::cost_of_what_is_held(problem, precisions, result.rotations, detail::log_cost,
                                   log_prior_costs(problem, result.rotations));
  result.objective += held;
  for (Progress& progress : result.trace) progress.objective += held;
  return result;
}

ROTAVG_INLINE Certificate certify(const GroundedGraph& problem,
                                  const GroundedPrecisions& precisions, const Rotations& given,
                                  const CertificateOptions& options) {
  const Rotations R = detail::checked_to_ride(problem, given);
  const Rotations Q = problem.variables_from(R);
  const AnisotropicGraph graph = anisotropic_graph(problem, precisions);
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());
  std::vector<Elimination> eliminations =
      grounded_eliminations(graph.scalar(), problem.components(), num_threads);
  Certificate certificate = certify(graph, Q, problem.components(), eliminations, options);
  // That is of Q; f(R) - f* = f(Q) - f* + the excess of R.
  const auto at_R = detail::costs_of_components(problem, precisions, R);
  const auto held = detail::costs_of_components(problem, precisions, problem.nodes_from(Q));
  std::vector<double> excess(at_R.cost.size(), 0.0);
  for (std::size_t c = 0; c < excess.size(); ++c) {
    const double more = at_R.cost[c] - held.cost[c];
    if (more > at_R.rounding[c] + held.rounding[c]) excess[c] = more;
  }
  const auto measures = detail::measure_components(
      AnisotropicResiduals(graph, to_quaternions(Q), num_threads), problem.components());
  detail::add_excess(excess, measures, options.tolerance, certificate);
  return certificate;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_precisions.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/logarithms.hpp>
#include <rotavg/types.hpp>
#include <rotavg/uncertainty/covariance_impl.hpp>
#include <rotavg/uncertainty/covariance_with_priors.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// J with log(exp(r) exp(d)) = r + J^-1 d to first order.
inline Matrix3 right_jacobian(const Vector3& r) {
  const double angle = std::sqrt(dot(r, r));
  Matrix3 J = Matrix3::Identity();
  if (angle < 1e-6) return J;
  const Matrix3 K = hat(r);
  J -= (1.0 - std::cos(angle)) / (angle * angle) * K;
  J += (angle - std::sin(angle)) / (angle * angle * angle) * product(K, K);
  return J;
}

/// What edges know in the logarithms of their residuals, where tilts are small but headings are
/// not: there gravity, of which the first edge stands for both, has J^T H J.
/// @param Q of the variables
inline std::vector<Matrix3> information_of_edges(const GroundedGraph& problem,
                                                 const GroundedPrecisions& precisions,
                                                 const Rotations& Q) {
  std::vector<Matrix3> result = precisions_of_edges(problem, precisions, /*of_second=*/0.0);
  for (const Index k : problem.gravity().first) {
    const Matrix3 J = right_jacobian(log_residual(problem.graph().edges()[k], Q));
    result[k] = transposed_product(J, product(result[k], J));
  }
  return result;
}

/// @param pairs of variables
inline Covariances covariances_of_variables(const GroundedGraph& problem, const Rotations& given,
                                            const std::vector<NodePair>& pairs,
                                            CovarianceOptions options) {
  const Rotations R = checked_rotations(problem.given(), given);
  check_noise(options.noise_variance);
  if (!options.information.empty()) {
    options.information = detail::information_of_edges(
        problem, {std::move(options.information), options.prior_information},
        problem.variables_from(R));
  }
  options.turn_of = problem.free_heading();
  options.free_turns.clear();
  std::vector<bool> held(static_cast<std::size_t>(problem.num_free_headings()), false);
  for (Index v = 0; v < problem.graph().num_nodes(); ++v) {
    const Index turn = options.turn_of[v];
    if (turn < 0 || held[turn]) continue;
    held[turn] = true;
    options.free_turns.push_back({v, problem.priors().down});
  }
  return covariances_of_pairs(problem.graph(), problem.variables_from(R), pairs, options);
}

}  // namespace detail

ROTAVG_INLINE Covariances covariances(const GroundedGraph& problem, const Rotations& R,
                                      const std::vector<NodePair>& pairs,
                                      const CovarianceOptions& options) {
  check_pairs(pairs, problem.given().num_nodes());
  std::vector<NodePair> variables;
  for (const NodePair& pair : pairs) {
    variables.push_back(
        {problem.riding().variable[pair.base], problem.riding().variable[pair.node]});
  }
  return detail::covariances_of_variables(problem, R, variables, options);
}

ROTAVG_INLINE Covariances marginal_covariances(const GroundedGraph& problem, const Rotations& R,
                                               const CovarianceOptions& options) {
  const Components& components = problem.components();
  std::vector<NodePair> variables;
  for (const Index v : problem.riding().variable) {
    variables.push_back({components.root(components.label[v]), v});
  }
  return detail::covariances_of_variables(problem, R, variables, options);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/certify/certificate_impl.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/certify_with_priors.hpp>
#include <rotavg/certify/excess.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// By how much the objective of every component is larger at R (n,) than where the variables hold
/// the nodes, from differences, which the objectives themselves would drown; zero to rounding.
/// @param held (n,) nodes_from() the variables that are next to R
inline std::vector<double> excess_of(const GroundedGraph& problem, const Rotations& R,
                                     const Rotations& held) {
  std::vector<double> excess(problem.components().nodes.size(), 0.0), f = excess, total = excess;
  const auto add = [&](Index node, double weight, const Matrix3& at_R, const Matrix3& at_held) {
    const Index c = problem.components().label[problem.riding().variable[node]];
    for (int k = 0; k < 9; ++k) {
      excess[c] += weight * (at_R(k) - at_held(k)) * (at_R(k) + at_held(k));
      f[c] += weight * at_R(k) * at_R(k);
    }
    total[c] += weight;
  };
  for (Index k = 0; k < problem.given().num_edges(); ++k) {
    const Edge& e = problem.given().edges()[k];
    add(e.i, problem.weights()[k], residual(e, R), residual(e, held));
  }
  const CheckedPriors& priors = problem.priors();
  for (const auto& p : priors.absolute) {
    add(p.node, p.weight, R[p.node] - p.world_from_node, held[p.node] - p.world_from_node);
  }
  for (const auto& p : priors.gravity) {
    const auto missed = [&](const Matrix3& world_from_node) {
      Matrix3 column = Matrix3::Zero();
      const Vector3 down = product(world_from_node, p.down);
      for (int k = 0; k < 3; ++k) column(k) = down(k) - priors.down(k);
      return column;
    };
    add(p.node, 2.0 * p.weight, missed(R[p.node]), missed(held[p.node]));
  }
  for (std::size_t c = 0; c < excess.size(); ++c) {
    if (excess[c] <= objective_rounding(total[c], f[c])) excess[c] = 0.0;
  }
  return excess;
}

}  // namespace detail

ROTAVG_INLINE Certificate certify(const GroundedGraph& problem, const Rotations& given,
                                  const CertificateOptions& options) {
  const Rotations R = detail::checked_to_ride(problem, given);
  const Rotations Q = problem.variables_from(R), held = problem.nodes_from(Q);
  std::vector<Elimination> eliminations = grounded_eliminations(
      problem.graph(), problem.components(), resolve_num_threads(options.num_threads));
  Certificate certificate = certify(problem.graph(), Q, problem.components(), eliminations, options,
                                    {}, problem.gravity());
  // That is of Q; f(R) - f* = f(Q) - f* + the excess of R.
  const std::vector<double> excess = detail::excess_of(problem, R, held);
  if (std::count(excess.begin(), excess.end(), 0.0) == static_cast<std::ptrdiff_t>(excess.size())) {
    return certificate;
  }
  const int num_threads = resolve_num_threads(options.num_threads, problem.graph().num_edges());
  const ResidualQuaternions residuals(problem.graph(), to_quaternions(Q), num_threads);
  const auto measures =
      detail::measure_components(NodeSums(residuals), problem.components(), problem.gravity());
  detail::add_excess(excess, measures, options.tolerance, certificate);
  return certificate;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Bounds how far any rotations are from the global optimum of measurements and priors, whoever
/// found them.
///
/// @param given world_from_i, one rotation per node, in the world of the priors
/// @throws std::invalid_argument unless there is a rotation for each node
/// @throws InvalidRotation for a node that is not where its fixed rotation, or its rig, holds it
inline Certificate certify(const GroundedGraph& problem, const Rotations& given,
                           const CertificateOptions& options = {}) {
  constexpr double most = 1e-6;  // radians
  const Rotations R = checked_rotations(problem.given(), given);
  const Rotations Q = problem.variables_from(R), held = problem.nodes_from(Q);
  for (std::size_t i = 0; i < R.size(); ++i) {
    if (angle_between(R[i], held[i]) > most) {
      throw InvalidRotation(static_cast<Index>(i),
                            "is not where a fixed rotation or its rig holds the node");
    }
  }
  std::vector<Elimination> eliminations =
      grounded_eliminations(problem.graph(), problem.components());
  return certify(problem.graph(), Q, problem.components(), eliminations, options, {},
                 problem.gravity());
}

}  // namespace rotavg

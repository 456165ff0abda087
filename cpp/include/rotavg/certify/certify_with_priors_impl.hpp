#pragma once

#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/certify_with_priors.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

ROTAVG_INLINE Certificate certify(const GroundedGraph& problem, const Rotations& given,
                                  const CertificateOptions& options) {
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

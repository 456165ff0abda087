#pragma once

#include <cstddef>
#include <vector>

#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Rotations, one for each given node, that are where fixed rotations and rigs hold them.
/// @throws as certify()
inline Rotations checked_to_ride(const GroundedGraph& problem, const Rotations& given) {
  Rotations R = checked_rotations(problem.given(), given);
  const Rotations held = problem.nodes_from(problem.variables_from(R));
  for (std::size_t i = 0; i < R.size(); ++i) {
    if (angle_between(R[i], held[i]) > max_contradiction) {
      throw InvalidRotation(static_cast<Index>(i),
                            "is not where a fixed rotation or its rig holds the node");
    }
  }
  return R;
}

/// Makes the certificate of the variables that of rotations whose objective is larger.
/// @param excess by how much, of every component; zero to rounding
inline void add_excess(const std::vector<double>& excess, const std::vector<Measure>& measures,
                       double tolerance, Certificate& certificate) {
  for (std::size_t c = 0; c < excess.size(); ++c) {
    if (excess[c] == 0.0) continue;
    ComponentCertificate& part = certificate.components[c];
    Measure measure = measures[c];
    measure.objective += excess[c];
    part.gap += excess[c];
    part.relative_gap = measure.relative(part.gap);
    part.verdict = verdict_of(part, tolerance);
    if (part.verdict == Verdict::not_certified && part.shortfall == Shortfall::none) {
      part.shortfall = Shortfall::leftover;
    }
    certificate.gap += excess[c];
    if (!(part.relative_gap <= certificate.relative_gap)) certificate.shortfall = part.shortfall;
    certificate.relative_gap = larger(certificate.relative_gap, part.relative_gap);
  }
  certificate.verdict = verdict_of(certificate, tolerance);
}

}  // namespace detail

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_precisions.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/solve/anisotropic.hpp>
#include <rotavg/solve/logarithms.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

ROTAVG_INLINE IterationResult refine_anisotropic(const MeasurementGraph& graph,
                                                 const std::vector<Matrix3>& information,
                                                 Rotations R, const IterationOptions& options) {
  const std::vector<Matrix3> omega =
      checked_precisions(graph.num_edges(), information, "information matrices");
  const GravityPairs none;
  return minimise_logarithms(LogObjective(graph, omega, none),
                             checked_rotations(graph, std::move(R)), options);
}

}  // namespace rotavg

#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
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
  if (information.size() != graph.edges().size()) {
    throw std::invalid_argument("found " + std::to_string(information.size()) +
                                " information matrices; expected one for each edge");
  }
  const GravityPairs none;
  return minimise_logarithms(LogObjective(graph, information, none), std::move(R), options);
}

}  // namespace rotavg

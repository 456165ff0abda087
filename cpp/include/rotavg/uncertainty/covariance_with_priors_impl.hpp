#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/types.hpp>
#include <rotavg/uncertainty/covariance_impl.hpp>
#include <rotavg/uncertainty/covariance_with_priors.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// @param pairs of variables
inline Covariances covariances_of_variables(const GroundedGraph& problem, const Rotations& R,
                                            const std::vector<NodePair>& pairs,
                                            CovarianceOptions options) {
  if (!options.information.empty()) {
    throw std::invalid_argument("information of the edges is for graphs without priors");
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
  return covariances(problem.graph(), problem.variables_from(R), pairs, options);
}

}  // namespace detail

ROTAVG_INLINE Covariances covariances(const GroundedGraph& problem, const Rotations& R,
                                      const std::vector<NodePair>& pairs,
                                      const CovarianceOptions& options) {
  std::vector<NodePair> variables;
  for (const NodePair& pair : pairs) {
    for (const Index node : {pair.base, pair.node}) {
      if (node >= 0 && node < problem.given().num_nodes()) continue;
      throw std::invalid_argument("a pair is of row " + std::to_string(node) +
                                  ", and the graph has " +
                                  std::to_string(problem.given().num_nodes()) + " nodes");
    }
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

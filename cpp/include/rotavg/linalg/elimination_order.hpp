#pragma once

#include <cstddef>
#include <new>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#ifdef ROTAVG_EIGEN_AMD
#include <rotavg/linalg/eigen_minimum_degree.hpp>
#else
#include <amd.h>
#endif

#include <rotavg/linalg/block_pattern.hpp>

namespace rotavg {

/// Approximate minimum degree (Amestoy, Davis and Duff 2004), by SuiteSparse's AMD; by Eigen's,
/// where ROTAVG_EIGEN_AMD is defined.
/// @throws std::bad_alloc
inline EliminationOrder approximate_minimum_degree(const BlockPattern& pattern) {
#ifdef ROTAVG_EIGEN_AMD
  return eigen_minimum_degree(pattern);
#else
  EliminationOrder order;
  if (pattern.size() == 0) return order;  // amd_order takes no null pointers
  order.node.resize(static_cast<std::size_t>(pattern.size()));
  double control[AMD_CONTROL], info[AMD_INFO];
  amd_defaults(control);
  const int status = amd_order(pattern.size(), pattern.start.data(), pattern.row.data(),
                               order.node.data(), control, info);
  if (status == AMD_OUT_OF_MEMORY) throw std::bad_alloc();
  if (status < 0) throw std::logic_error("the pattern is not that of a symmetric matrix");
  order.multiplications = info[AMD_NMULTSUBS_LDL] + info[AMD_LNZ] + pattern.size();
  order.nonzeros = info[AMD_LNZ];
  return order;
#endif
}

/// The order as it stands. Row i of the factor fills in nowhere before its first entry (its
/// envelope, George and Liu 1981), which bounds the work: small where nodes are joined to those
/// just before them, as in a video or on a trajectory.
inline EliminationOrder natural_order(const BlockPattern& pattern) {
  const Index n = pattern.size();
  EliminationOrder order;
  order.node.resize(static_cast<std::size_t>(n));
  std::iota(order.node.begin(), order.node.end(), Index{0});
  std::vector<bool> has_begun(order.node.size(), false);  // of the envelopes of rows
  double below = 0.0;                                     // rows whose envelope holds the column
  for (Index j = 0; j < n; ++j) {
    const auto column = static_cast<std::size_t>(j);
    if (has_begun[column]) below -= 1.0;  // it ends at the diagonal
    for (Index e = pattern.start[column] + 1; e < pattern.start[column + 1]; ++e) {
      auto begun = has_begun[static_cast<std::size_t>(pattern.row[static_cast<std::size_t>(e)])];
      if (!begun) below += 1.0;
      begun = true;
    }
    order.nonzeros += below;
    order.multiplications += below + 0.5 * below * (below + 1.0) + 1.0;
  }
  return order;
}

/// The one of these orders that takes less work.
/// @throws std::bad_alloc
inline EliminationOrder elimination_order(const BlockPattern& pattern) {
  EliminationOrder order = approximate_minimum_degree(pattern);
  EliminationOrder natural = natural_order(pattern);
  if (natural.multiplications < order.multiplications) std::swap(order, natural);
  return order;
}

}  // namespace rotavg

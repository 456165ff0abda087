#pragma once

#include <cstddef>
#include <new>
#include <stdexcept>
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

}  // namespace rotavg

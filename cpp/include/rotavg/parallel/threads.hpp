#pragma once

#ifdef _OPENMP
#include <omp.h>
#endif

#include <rotavg/types.hpp>

namespace rotavg {

/// Number of threads to use for a request: a positive number is taken as it is, anything else means
/// "all processors of this process". Work of fewer items than some thousands gets one thread, whose
/// wake-up would otherwise cost more than the work.
inline int resolve_num_threads(int requested, Index num_items) {
  constexpr Index worthwhile = 8192;
  if (num_items < worthwhile) return 1;
  if (requested > 0) return requested;
#ifdef _OPENMP
  return omp_get_num_procs();
#else
  return 1;
#endif
}

/// Calls f(k) for k = 0 … count-1, in any order, on `num_threads` threads. Calls must not depend on
/// one another and must not throw.
template <typename Function>
void parallel_for(Index count, int num_threads, Function&& f) {
#ifdef _OPENMP
#pragma omp parallel for schedule(static) num_threads(num_threads) if (num_threads > 1)
#else
  (void)num_threads;
#endif
  for (Index k = 0; k < count; ++k) f(k);
}

}  // namespace rotavg

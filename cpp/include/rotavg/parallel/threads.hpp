#pragma once

#include <algorithm>

#ifdef _OPENMP
#include <omp.h>
#endif

#include <rotavg/types.hpp>

namespace rotavg {

/// Number of threads to use for a request: a positive number as it is, anything else for all
/// processors of this process; but only one for every 8192 items to work on: less work takes less
/// time than threads take to meet, above all where others use the processors as well.
inline int resolve_num_threads(int requested, Index num_items) {
  constexpr Index worthwhile = 8192;
#ifdef _OPENMP
  const int wanted = requested > 0 ? requested : omp_get_num_procs();
#else
  const int wanted = requested > 0 ? requested : 1;
#endif
  return std::max(1, std::min(wanted, num_items / worthwhile));
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

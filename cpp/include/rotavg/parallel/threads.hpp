#pragma once

#include <algorithm>
#include <thread>

#ifdef __linux__
#include <sched.h>
#endif

#include <rotavg/parallel/team.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Number of threads for a request: a positive number as it is, anything else for all processors
/// of this process.
inline int resolve_num_threads(int requested) {
  if (requested > 0) return requested;
#ifdef __linux__
  cpu_set_t processors;
  if (sched_getaffinity(0, sizeof processors, &processors) == 0) return CPU_COUNT(&processors);
#endif
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// As many of the threads as some work is worth, in multiplications or what takes as long: less
/// takes less time than threads take to meet.
inline int threads_for(int num_threads, double work) {
  constexpr double worthwhile = 2.5e5;
  return static_cast<int>(std::clamp(work / worthwhile, 1.0, std::max(1.0, 1.0 * num_threads)));
}

/// Multiplications that take about as long as reading one edge at one end.
constexpr double work_of_pass = 30.0;

/// The same for passes over so many edges.
inline int resolve_num_threads(int requested, Index num_edges) {
  return threads_for(resolve_num_threads(requested), 2.0 * work_of_pass * num_edges);
}

/// The same for loops that do little for each of so many nodes, some tens of multiplications.
inline int threads_for_nodes(int num_threads, Index num_nodes) {
  return threads_for(num_threads, work_of_pass * num_nodes);
}

/// Calls f(k) for k = 0 … count-1, in any order, on at most `num_threads` threads. Calls must not
/// depend on one another; what one throws is thrown here.
template <typename Function>
void parallel_for(Index count, int num_threads, Function&& f) {
  if (count <= 0) return;
  // More parts than threads: who comes late, or is held up, takes fewer.
  const long long parts_each = num_threads > 1 ? 6 : 1;
  const auto parts =
      static_cast<Index>(std::min<long long>(count, parts_each * std::max(num_threads, 1)));
  const auto begin_of = [&](Index part) {
    if (part == 0 || part == parts) return part == 0 ? 0 : count;
    return static_cast<Index>(static_cast<long long>(count) * part / parts);
  };
  Team::run(
      parts, num_threads,
      [&](Index part) {
        const Index end = begin_of(part + 1);
        for (Index k = begin_of(part); k < end; ++k) f(k);
      },
      [] {});
}

}  // namespace rotavg

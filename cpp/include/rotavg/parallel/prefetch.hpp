#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// Asks the memory for what will be read soon.
inline void prefetch(const void* address) {
#if defined(__GNUC__)
  __builtin_prefetch(address);
#else
  (void)address;
#endif
}

/// Whether a table is so large that what is read here and there in it is not in the cache.
template <typename T, typename Allocator>
bool is_far(const std::vector<T, Allocator>& table) {
  constexpr std::size_t cache = std::size_t{1} << 20;
  return table.size() * sizeof(T) > cache;
}

/// The same for all of something that may reach into the next line of the cache.
template <typename T>
void prefetch_object(const T& object) {
  const char* const first = reinterpret_cast<const char*>(&object);
  prefetch(first);
  prefetch(first + sizeof(T) - 1);
}

/// The same in a pass over all of something, for what comes some way after place k: a loop that
/// does much with each entry runs into the end of every page that the processor has read ahead.
template <typename T, typename Allocator>
void prefetch_ahead(const std::vector<T, Allocator>& values, Index k) {
  constexpr std::size_t ahead = 8192 / sizeof(T);
  prefetch(values.data() + std::min(static_cast<std::size_t>(k) + ahead, values.size() - 1));
}

}  // namespace rotavg

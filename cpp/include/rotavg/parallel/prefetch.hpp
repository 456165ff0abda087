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

/// The same in a pass over all of something, for what comes some way after place k: a loop that
/// does much with each entry runs into the end of every page that the processor has read ahead.
template <typename T, typename Allocator>
void prefetch_ahead(const std::vector<T, Allocator>& values, Index k) {
  constexpr std::size_t ahead = 8192 / sizeof(T);
  prefetch(values.data() + std::min(static_cast<std::size_t>(k) + ahead, values.size() - 1));
}

}  // namespace rotavg

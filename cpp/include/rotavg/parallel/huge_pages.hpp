#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <new>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace rotavg {

/// Memory for loops that go through much of it: on huge pages, where it is large and the system has
/// them. To touch it for the first time, 4 KB by 4 KB, takes as long as computing what is written
/// there, and to read it here and there waits for the page table. For std::free().
/// @param large from how many bytes on
/// @throws std::bad_alloc
inline void* allocate_large(std::size_t bytes, std::size_t large) {
  constexpr std::size_t small = 64, huge_page = std::size_t{1} << 21;
  if (bytes > std::numeric_limits<std::size_t>::max() / 2) throw std::bad_alloc();
  const std::size_t alignment = bytes < std::max(large, huge_page) ? small : huge_page;
  const std::size_t rounded =
      (std::max<std::size_t>(bytes, 1) + alignment - 1) / alignment * alignment;
  void* const memory = std::aligned_alloc(alignment, rounded);
  if (memory == nullptr) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
  if (alignment == huge_page) madvise(memory, rounded, MADV_HUGEPAGE);  // only advice
#endif
  return memory;
}

/// The same for the containers of the standard library.
template <typename T>
struct LargeAllocator {
  using value_type = T;

  LargeAllocator() = default;
  template <typename U>
  LargeAllocator(const LargeAllocator<U>&) {}

  T* allocate(std::size_t size) {
    // What is less, the C library keeps for the next that asks, touched as it is.
    constexpr std::size_t large = std::size_t{1} << 24;
    if (size > std::numeric_limits<std::size_t>::max() / sizeof(T)) throw std::bad_alloc();
    return static_cast<T*>(allocate_large(size * sizeof(T), large));
  }
  void deallocate(T* memory, std::size_t) noexcept { std::free(memory); }

  template <typename U>
  bool operator==(const LargeAllocator<U>&) const {
    return true;
  }
  template <typename U>
  bool operator!=(const LargeAllocator<U>&) const {
    return false;
  }
};

/// A vector that may be large: something for every edge, or for every node.
template <typename T>
using LargeVector = std::vector<T, LargeAllocator<T>>;

}  // namespace rotavg

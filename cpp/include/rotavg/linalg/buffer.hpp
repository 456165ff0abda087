#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <memory>
#include <new>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace rotavg {

/// Numbers without initial values. Large ones lie on huge pages where the system has them: touching
/// a factor's memory for the first time, 4 KB by 4 KB, takes as long as computing it.
class Buffer {
 public:
  Buffer() = default;
  /// @throws std::bad_alloc
  explicit Buffer(std::size_t size) {
    constexpr std::size_t small = 64, huge_page = std::size_t{1} << 21;
    if (size > std::numeric_limits<std::size_t>::max() / (2 * sizeof(double)))
      throw std::bad_alloc();
    const std::size_t bytes = std::max<std::size_t>(size * sizeof(double), 1);
    const std::size_t alignment = bytes < huge_page ? small : huge_page;
    const std::size_t rounded = (bytes + alignment - 1) / alignment * alignment;
    data_.reset(static_cast<double*>(std::aligned_alloc(alignment, rounded)));
    if (!data_) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
    if (alignment == huge_page) madvise(data_.get(), rounded, MADV_HUGEPAGE);  // only advice
#endif
  }
  double* data() { return data_.get(); }
  const double* data() const { return data_.get(); }

 private:
  struct Free {
    void operator()(double* data) const { std::free(data); }
  };
  std::unique_ptr<double[], Free> data_;
};

}  // namespace rotavg

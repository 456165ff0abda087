#pragma once

#include <cstddef>
#include <cstdlib>
#include <limits>
#include <memory>
#include <new>

#include <rotavg/parallel/huge_pages.hpp>

namespace rotavg {

/// Numbers without initial values, on huge pages where there are many.
class Buffer {
 public:
  Buffer() = default;
  /// @throws std::bad_alloc
  explicit Buffer(std::size_t size) {
    if (size > std::numeric_limits<std::size_t>::max() / sizeof(double)) throw std::bad_alloc();
    data_.reset(static_cast<double*>(allocate_large(size * sizeof(double), 0)));
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

#pragma once

#include <limits>

#if __has_include(<unistd.h>)
#include <unistd.h>
#endif

namespace rotavg {

/// Bytes of memory that this machine has; infinity where that is not known.
inline double physical_memory() {
#ifdef _SC_PHYS_PAGES
  const double pages = static_cast<double>(sysconf(_SC_PHYS_PAGES));
  const double bytes = pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  if (pages > 0.0 && bytes > 0.0) return bytes;
#endif
  return std::numeric_limits<double>::infinity();
}

}  // namespace rotavg

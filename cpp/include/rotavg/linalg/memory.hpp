#pragma once

#include <limits>
#include <stdexcept>

#if __has_include(<unistd.h>)
#include <unistd.h>
#endif

namespace rotavg {

/// What this machine's memory does not hold.
class TooLarge : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Bytes of memory that this machine has; infinity where that is not known.
inline double physical_memory() {
#ifdef _SC_PHYS_PAGES
  const double pages = static_cast<double>(sysconf(_SC_PHYS_PAGES));
  const double bytes = pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  if (pages > 0.0 && bytes > 0.0) return bytes;
#endif
  return std::numeric_limits<double>::infinity();
}

/// Bytes that one computation may count on: what is free, and at least half of all, as the system
/// gives back what it keeps of files.
inline double available_memory() {
  const double all = physical_memory();
#ifdef _SC_AVPHYS_PAGES
  const double pages = static_cast<double>(sysconf(_SC_AVPHYS_PAGES));
  const double bytes = 0.9 * pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  if (bytes > 0.5 * all) return bytes;
#endif
  return 0.5 * all;
}

}  // namespace rotavg

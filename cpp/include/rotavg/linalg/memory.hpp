#pragma once

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>

#if __has_include(<unistd.h>)
#include <unistd.h>
#endif
#ifdef __linux__
#include <sys/resource.h>
#endif

namespace rotavg {

/// What this machine's memory does not hold.
class TooLarge : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Memory in bytes; infinity where it is not known.
struct Memory {
  double all = std::numeric_limits<double>::infinity();   ///< that this process may ever have
  double free = std::numeric_limits<double>::infinity();  ///< that nobody uses

  void restrict_to(double other_all, double other_free) {
    all = std::min(all, other_all);
    free = std::min(free, std::max(other_free, 0.0));
  }
};

namespace detail {

/// The number at the beginning of a file of the system, or after a word in it; NaN without one.
inline double number_in_file(const char* path, const char* word = "") {
  double number = std::numeric_limits<double>::quiet_NaN();
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path, "r"), std::fclose);
  if (!file) return number;
  char found[64] = "";
  while (std::strcmp(found, word) != 0 && std::fscanf(file.get(), "%63s", found) == 1) {
  }
  if (std::fscanf(file.get(), "%lf", &number) != 1) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return number;
}

/// What a container or a batch system allows (Linux's control groups, both versions).
/// @param all, used, statistics files of such a group, as a process in it sees them
/// @param files the word before what is kept of files
inline void restrict_to_group(Memory& memory, const char* all, const char* used,
                              const char* statistics, const char* files) {
  const double limit = number_in_file(all);
  if (!(limit > 0.0 && limit < memory.all)) return;       // "max", or no group
  const double kept = number_in_file(statistics, files);  // of files: given back when asked for
  const double in_use = number_in_file(used) - (kept > 0.0 ? kept : 0.0);
  memory.restrict_to(limit, limit - (in_use > 0.0 ? in_use : 0.0));
}

}  // namespace detail

/// What this machine has, and what limits this process (ulimit, control groups).
inline Memory memory() {
  Memory memory;
#ifdef _SC_PHYS_PAGES
  const double page = static_cast<double>(sysconf(_SC_PAGESIZE));
  const double pages = static_cast<double>(sysconf(_SC_PHYS_PAGES));
  if (pages > 0.0 && page > 0.0) {
    memory.all = pages * page;
    memory.free = memory.all;
#ifdef _SC_AVPHYS_PAGES
    // What is free, and at least half of all: the system gives back what it keeps of files.
    const double unused = 0.9 * page * static_cast<double>(sysconf(_SC_AVPHYS_PAGES));
    memory.free = std::max(unused, 0.5 * memory.all);
#endif
  }
#endif
#ifdef __linux__
  detail::restrict_to_group(memory, "/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current",
                            "/sys/fs/cgroup/memory.stat", "inactive_file");
  detail::restrict_to_group(memory, "/sys/fs/cgroup/memory/memory.limit_in_bytes",
                            "/sys/fs/cgroup/memory/memory.usage_in_bytes",
                            "/sys/fs/cgroup/memory/memory.stat", "total_inactive_file");
  constexpr double kilobyte = 1024.0;
  const auto restrict_to_limit = [&](auto resource, const char* used) {
    rlimit limit{};
    if (getrlimit(resource, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return;
    const double all = static_cast<double>(limit.rlim_cur);
    const double in_use = kilobyte * detail::number_in_file("/proc/self/status", used);
    memory.restrict_to(all, all - (in_use > 0.0 ? in_use : 0.0));
  };
  restrict_to_limit(RLIMIT_AS, "VmSize:");
  restrict_to_limit(RLIMIT_DATA, "VmData:");
#endif
  return memory;
}

/// Bytes of memory that this process may ever have; infinity where that is not known.
inline double physical_memory() { return memory().all; }

/// Whether one computation may count on so many bytes.
inline bool has_memory_for(double bytes) {
  constexpr double little = 64e6;  // not worth asking the system
  return bytes <= little || bytes <= memory().free;
}

}  // namespace rotavg

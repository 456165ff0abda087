#pragma once

// How all solvers take their options from Python.

#include <cstdint>
#include <optional>

#include <rotavg/certify/bound.hpp>
#include <rotavg/solve/options.hpp>

#include "convert.hpp"
#include "interrupt.hpp"

namespace rotavg_python {

/// @param callback of Python; must outlive the result
/// @param iterations_before of what was told already, the initial value included; negative where
///        this is the first that is told
inline rotavg::ProgressCallback calling(const py::function& callback, int iterations_before = -1) {
  return [&callback, iterations_before](rotavg::Progress progress) {
    if (progress.iteration == 0 && iterations_before >= 0) return true;
    if (iterations_before > 0) progress.iteration += iterations_before;
    const WithGil gil;
    return unless_the_program_ends([&] {
      const py::object answer = callback(progress);
      return answer.is_none() || answer.cast<bool>();
    });
  };
}

/// @param callback, signals must outlive the result
inline rotavg::IterationOptions iteration_options(double tolerance, int max_iterations,
                                                  double time_limit, int num_threads,
                                                  const std::optional<py::function>& callback,
                                                  SignalCheck& signals,
                                                  int iterations_before = -1) {
  rotavg::IterationOptions options;
  options.tolerance = tolerance;
  options.max_iterations = max_iterations;
  options.time_limit = time_limit;
  options.num_threads = num_threads;
  options.keep_going = signals.keep_going();
  if (callback) options.callback = calling(*callback, iterations_before);
  return options;
}

inline rotavg::CertificateOptions certificate_options(double tolerance, double failure_probability,
                                                      std::uint64_t seed, double max_flops) {
  rotavg::CertificateOptions options;
  options.tolerance = tolerance;
  options.failure_probability = failure_probability;
  options.seed = seed;
  options.max_factorization_flops = max_flops;
  return options;
}

}  // namespace rotavg_python

#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>

#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/solve/status.hpp>

namespace rotavg {

/// Whether only the leftover of the gradient keeps the gap open, or may be what does.
inline bool is_leftover(const ComponentCertificate& certificate) {
  constexpr double slight = 1e-2;  // slightly negative, it may be the leftover that makes S so
  return certificate.shortfall == Shortfall::leftover ||
         (certificate.shortfall == Shortfall::negative && certificate.relative_gap < slight);
}

/// Where that is so: more steps, to a smaller gradient, whose square the gap follows.
///
/// @param limits what is left of them
/// @param by_sweeps whether these are likely to be sweeps, or else Newton's
/// @param go_on (options, next) takes the steps from the solution `next`, and adds to it what they
///        did, with a gauge
/// @param certify of a solution
/// @returns whether the gap has become smaller
template <typename GoOn, typename Certify>
bool polish(Solution& solution, double certificate_tolerance, IterationOptions limits,
            bool by_sweeps, GoOn&& go_on, Certify&& certify) {
  constexpr double share = 0.1, falling = 0.7;
  // Sweeps take many more than Newton's method, and each costs much less.
  const int max_idle = by_sweeps ? 40 : 4, max_iterations = by_sweeps ? 400 : 100;
  const double gap = solution.certificate.relative_gap;
  limits.stop = StopRule::gradient;
  limits.tolerance = solution.relative_gradient * std::sqrt(share * certificate_tolerance / gap);
  limits.max_iterations = std::min(limits.max_iterations, max_iterations);
  double lowest = std::numeric_limits<double>::infinity();
  int idle = 0;  // iterations in which rounding kept the gradient from falling
  limits.callback = [&, told = limits.callback](const Progress& progress) {
    idle = progress.relative_gradient < falling * lowest ? 0 : idle + 1;
    lowest = std::min(lowest, progress.relative_gradient);
    return (!told || told(progress)) && idle < max_idle;
  };
  Solution next = solution;
  go_on(limits, next);
  const int steps = next.iterations - solution.iterations;
  next.status = solution.status;
  next.reason += "; " + std::to_string(steps) + " iterations more for the proof";
  if (steps == 0) return false;
  certify(next);
  const bool better = next.certificate.relative_gap < gap;
  if (better) {
    solution = std::move(next);
  } else {
    solution.timings = next.timings;
  }
  return better;
}

}  // namespace rotavg

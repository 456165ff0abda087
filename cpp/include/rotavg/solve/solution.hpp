#pragma once

#include <cstdint>
#include <string>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

namespace rotavg {

/// Where a linear system would cost too much, coarser graphs would be no smaller, or the time is
/// up, the shortest paths are used instead.
enum class Initialization {
  automatic,
  shortest_path,          ///< Lemma 3
  spanning_tree,          ///< along the edges that the graph supports best
  maximum_spanning_tree,  ///< along the edges with the largest weights
  multilevel,             ///< from coarser graphs to finer ones, sweep by sweep
  chordal,                ///< free matrices, then the nearest rotations
  quaternion,             ///< free quaternions, then unit ones
  random,
};

struct SolveOptions {
  Method method = Method::automatic;
  Initialization init = Initialization::automatic;
  std::uint64_t seed = 0;  ///< of the random initial value
  MuRule mu = MuRule::adaptive;
  bool accelerate = false;  ///< Anderson's mixing, of BCD and SUM; the others have no use for it
  bool certify = true;
  /// How high the staircase climbs, by the automatic choice or by Method::staircase; below
  /// Staircase::first_rank it is not used.
  int max_rank = 10;
  CertificateOptions certificate;  ///< its threads and keep_going are set from `iteration`
  /// Its limits count for everything together, and so do the iterations that its callback is told
  /// of. Once that has returned false, no further run begins.
  IterationOptions iteration;
};

/// @throws std::invalid_argument for a number out of range
inline void check(const SolveOptions& options) {
  check(options.iteration);
  check(options.certificate);
}

struct Timings {
  double init = 0.0;
  double solve = 0.0;
  double certify = 0.0;
};

/// The rotations, and of the run that ended there the course.
struct Solution : IterationResult {
  Method method = Method::automatic;  ///< the one that was used, in the end
  std::string reason;                 ///< what Method::automatic chose and why, in one line
  Initialization init = Initialization::automatic;
  Certificate certificate;
  Components components;
  Timings timings;  ///< seconds, of all runs
};

}  // namespace rotavg

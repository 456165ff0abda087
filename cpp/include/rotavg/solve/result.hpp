#pragma once

#include <vector>

#include <rotavg/solve/progress.hpp>
#include <rotavg/solve/status.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// What every iterative solver returns. All figures are evaluated at `rotations`, up to rounding
/// (the gauge is fixed after them); so is the trace, but for the objectives of bcdsr().
struct IterationResult {
  Rotations rotations;  ///< world_from_i
  Status status = Status::not_run;
  int iterations = 0;
  double objective = 0.0;
  double gradient_norm = 0.0;
  double relative_gradient = 0.0;
  double seconds = 0.0;
  std::vector<Progress> trace;  ///< the initial value, then one entry per iteration
};

}  // namespace rotavg

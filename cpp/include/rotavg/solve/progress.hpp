#pragma once

#include <functional>

namespace rotavg {

/// One iteration, evaluated at the rotations that it ended with.
struct Progress {
  int iteration = 0;
  double objective = 0.0;
  double gradient_norm = 0.0;      ///< |g|_2
  double relative_gradient = 0.0;  ///< GradientNorm::relative, radians
  double step = 0.0;               ///< the paper's relative step of this iteration
  double seconds = 0.0;            ///< since the solver started
};

/// Called after every iteration; returns whether to go on.
using ProgressCallback = std::function<bool(const Progress&)>;

}  // namespace rotavg

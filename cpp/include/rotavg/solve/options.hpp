#pragma once

#include <functional>
#include <limits>
#include <stdexcept>

#include <rotavg/solve/progress.hpp>

namespace rotavg {

enum class Method {
  automatic,
  bcd,     ///< block coordinate descent, Algorithm 2
  sum,     ///< successive upper-bound minimisation, Algorithm 3
  newton,  ///< Newton's method in the metric of the graph Laplacian
  /// the Riemannian staircase: up in rank at once, and down to rotations
  staircase,
  bcdsr,  ///< block coordinate descent on the semidefinite relaxation, the paper's baseline
};

/// Its name in sentences.
inline const char* name_of(Method method) {
  constexpr const char* names[] = {"auto", "bcd", "sum", "newton", "staircase", "bcdsr"};
  return names[static_cast<int>(method)];
}

/// When an iteration has converged.
enum class StopRule {
  gradient,  ///< GradientNorm::relative <= tolerance
  /// The paper's: BCD stops at sum_k |R_k - R_k'| / |R_k| < tolerance, SUM at |R - R'| / |R| <
  /// tolerance. (BCDSR at |Y - Y'| / |Y| < tolerance: the paper does not give its rule.) On a badly
  /// conditioned graph a small step does not mean a small gradient.
  step,
};

/// What every iterative solver takes.
struct IterationOptions {
  StopRule stop = StopRule::gradient;
  double tolerance = 1e-9;
  int max_iterations = 20000;
  double time_limit = std::numeric_limits<double>::infinity();  ///< seconds
  int num_threads = 0;                                          ///< 0: all processors
  /// Called for the initial value and after every iteration; false stops.
  ProgressCallback callback;
  /// Asked after every iteration and in the middle of long ones; false stops.
  std::function<bool()> keep_going;
};

/// @throws std::invalid_argument unless the numbers are not negative
inline void check(const IterationOptions& options) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(what);
  };
  require(options.tolerance >= 0.0, "the tolerance must be a number that is not negative");
  require(options.max_iterations >= 0, "the iteration limit must not be negative");
  require(options.time_limit >= 0.0, "the time limit must be a number that is not negative");
}

/// How SUM (Algorithm 3) chooses mu, which makes B = mu I + Rt convex enough for its upper bound.
enum class MuRule {
  adaptive,        ///< mu_i = theta deg_i, theta = 0, 1/8, 1/4, 1/2, 1: raised when f does not fall
  min_eigenvalue,  ///< mu = -lambda_min(Rt), as printed
};

}  // namespace rotavg

#pragma once

namespace rotavg {

/// How a solver ended. Numerical trouble is a status, never an exception.
enum class Status {
  not_run,
  gradient_converged,  ///< the relative gradient is below the tolerance
  step_converged,      ///< the paper's rule: the relative step is below the tolerance
  iteration_limit,     ///< stopped at the iteration limit, before convergence
  time_limit,          ///< stopped at the time limit, before convergence
  stopped,             ///< by the callback, before convergence or before a run that was to follow
};

/// Whether the solver met its stopping rule.
inline bool is_converged(Status status) {
  return status == Status::gradient_converged || status == Status::step_converged;
}

}  // namespace rotavg

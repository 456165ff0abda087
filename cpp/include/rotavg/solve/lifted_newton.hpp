#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <utility>

#include <Eigen/Core>

#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/flat.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/problem/lifted.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/stopwatch.hpp>
#include <rotavg/solve/truncated_cg.hpp>

namespace rotavg {

/// An approximate inverse of the connection Laplacian D (x) I - E, to which the Hessian / 2 is
/// close where residuals are small: that of its blocks at the first node and at all others, or,
/// where it is too large to factor, that of the degrees.
///
/// @tparam Problem LiftedProblemOf some blocks
template <typename Problem>
class ConnectionMetric {
 public:
  /// @param problem must outlive this object
  /// @param elimination of the component, without its root
  ConnectionMetric(const Problem& problem, Elimination& elimination, double max_flops,
                   const std::function<bool()>& keep_going)
      : problem_(problem) {
    if (elimination.flops(3, max_flops) > max_flops) return;
    cholesky_.emplace(elimination.symbolic(), elimination.num_threads());
    const auto outcome = cholesky_->factorize(
        connection_laplacian(problem.connection(), elimination), 0.0, keep_going);
    if (outcome != CholeskyOutcome::positive_definite) cholesky_.reset();
  }

  Eigen::MatrixXd apply(const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = X;
    const Index factored = cholesky_ ? problem_.num_nodes() - 1 : 0;
    for (Index a = 0; a < problem_.num_nodes() - factored; ++a) {
      for (Eigen::Index c = 0; c < Y.cols(); ++c) {
        for (int r = 0; r < 3; ++r) Y(3 * a + r, c) /= problem_.degree(a);
      }
    }
    if (factored > 0) cholesky_->solve_in_place(Y.bottomRows(3 * factored));
    return Y;
  }

 private:
  const Problem& problem_;
  std::optional<BlockCholesky<3>> cholesky_;
};

struct LiftedResult {
  LiftedPoint point;
  int iterations = 0;
  bool converged = false;
};

/// Newton's method on the lifted problem, as solve/newton.hpp on the rotations themselves:
/// truncated conjugate gradients, a preconditioner that is factored once, and a line search that
/// lets the objective fall (Armijo).
///
/// @param Z the initial value
/// @param options its tolerance is that of LiftedPoint::relative_gradient; no callback is called
template <typename Problem>
LiftedResult lifted_newton(const Problem& problem, ConnectionMetric<Problem>& metric,
                           LiftedBlocks Z, const IterationOptions& options) {
  constexpr int max_cg_steps = 50;
  constexpr int max_halvings = 40;
  constexpr double sufficient = 1e-4;
  const Stopwatch watch;
  LiftedResult result;
  LiftedPoint& at = result.point;
  at = problem.evaluate(std::move(Z));
  TruncatedCg<LiftedBlocks> newton_direction;
  const double total_weight = connection_weight(problem.connection());
  for (;; ++result.iterations) {
    result.converged = at.relative_gradient <= options.tolerance;
    const bool interrupted = options.keep_going && !options.keep_going();
    if (result.converged || interrupted || result.iterations >= options.max_iterations ||
        watch.seconds() >= options.time_limit) {
      return result;
    }
    const LiftedBlocks& V = newton_direction(
        at.gradient, std::min(0.1, std::sqrt(at.relative_gradient)), max_cg_steps,
        problem.connection().num_threads(),
        [&](const LiftedBlocks& p, LiftedBlocks& Hp) { Hp = problem.hessian(at, p); },
        [&](const LiftedBlocks& r, LiftedBlocks& z) {
          z = 0.5 * metric.apply(r);
          problem.project(at.Z, z);
        });
    const double slope = flat_dot(at.gradient, V);
    double t = 1.0;
    LiftedBlocks next;
    for (int k = 0; k < max_halvings; ++k, t *= 0.5) {
      next = problem.retract(at.Z, t * V);
      const double enough =
          at.objective + sufficient * t * slope + objective_rounding(total_weight, at.objective);
      if (problem.objective(next) <= enough) break;
      next.resize(0, 0);
    }
    if (next.size() == 0) return result;  // rounding lets it fall no further
    at = problem.evaluate(std::move(next));
  }
}

}  // namespace rotavg

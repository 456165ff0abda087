#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/bcd.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/hessian.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/solve/truncated_cg.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The inverse of the Hessian at some rotations, but for the turns p of its edges; the first node
/// of every component is held. (The scalar Laplacian would do where all axes are known alike.)
class AnisotropicMetric {
 public:
  /// @param eliminations of all components, without their roots; must outlive this object
  explicit AnisotropicMetric(std::vector<Elimination>& eliminations)
      : eliminations_(eliminations) {}

  CholeskyOutcome factorize(const AnisotropicResiduals& residuals,
                            const std::function<bool()>& keep_going) {
    factors_.clear();
    for (Elimination& elimination : eliminations_) {
      if (elimination.size() == 0) continue;
      factors_.push_back(
          {&elimination, BlockCholesky<3>(elimination.symbolic(), elimination.num_threads())});
      const auto outcome = factors_.back().cholesky.factorize(
          hessian_blocks(residuals, elimination, /*with_turns=*/false), 0.0, keep_going);
      if (outcome != CholeskyOutcome::positive_definite) return outcome;
    }
    return CholeskyOutcome::positive_definite;
  }

  void apply(const NodeVectors& v, NodeVectors& result) {
    result.setZero(v.rows(), 3);
    for (Factor& factor : factors_) {
      const Elimination& elimination = *factor.elimination;
      free_.resize(3 * static_cast<Eigen::Index>(elimination.size()), 1);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) free_(3 * a + k, 0) = v(elimination.node(a), k);
      }
      factor.cholesky.solve_in_place(free_);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) result(elimination.node(a), k) = free_(3 * a + k, 0);
      }
    }
  }

 private:
  struct Factor {
    const Elimination* elimination;
    BlockCholesky<3> cholesky;
  };

  std::vector<Elimination>& eliminations_;
  std::vector<Factor> factors_;
  Eigen::MatrixXd free_;
};

/// Newton's method with conjugate gradients and a line search (Armijo) on general blocks, as
/// solve/newton.hpp. The preconditioner is factored at the start; where it is not positive definite
/// there, coordinate descent goes on instead.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
inline IterationResult newton(const AnisotropicGraph& graph, const Rotations& R,
                              std::vector<Elimination>& eliminations,
                              const IterationOptions& options = {}) {
  constexpr int max_cg_steps = 50;
  constexpr int max_halvings = 40;
  constexpr double sufficient = 1e-4;
  Monitor monitor(graph.scalar(), R, options);
  const int num_threads = monitor.num_threads();
  Quaternions q = to_quaternions(R), next(q);
  AnisotropicResiduals residuals(graph, q, num_threads);
  AnisotropicMetric metric(eliminations);
  const auto outcome = metric.factorize(residuals, [&] { return monitor.keep_going(); });
  if (outcome == CholeskyOutcome::not_positive_definite) {
    IterationOptions rest = options;
    rest.time_limit -= monitor.seconds();
    return bcd(graph, R, rest);
  }
  if (outcome == CholeskyOutcome::stopped) {
    monitor.should_stop(residuals.objective(), residuals.gradient_norm(), 0.0);
    return std::move(monitor).result(R);
  }
  NodeVectors g(graph.num_nodes(), 3);
  TruncatedCg<NodeVectors> newton_direction;
  double step = 0.0;
  while (!monitor.should_stop(residuals.objective(), residuals.gradient_norm(), step)) {
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      g.row(i) = residuals.gradient(i).transpose();
    }
    const double forcing = std::min(0.1, std::sqrt(monitor.relative_gradient()));
    const NodeVectors& w = newton_direction(
        g, forcing, max_cg_steps, monitor.num_threads(),
        [&](const NodeVectors& p, NodeVectors& Hp) { apply_hessian(residuals, p, Hp); },
        [&](const NodeVectors& r, NodeVectors& z) { metric.apply(r, z); });
    const double slope = g.cwiseProduct(w).sum(), f = residuals.objective();

    double t = 1.0;
    for (int k = 0;; ++k, t *= 0.5) {
      if (k == max_halvings) {  // rounding, or no direction of descent: a sweep never rises
        Rotations swept = to_rotations(q);
        bcd_sweep(graph, swept, monitor);
        next = to_quaternions(swept);
        residuals.update(next);
        break;
      }
      for (Index i = 0; i < graph.num_nodes(); ++i) {
        next[i] = graph.row(i).size() == 0 ? q[i] : turned(q[i], t * w.row(i).transpose());
      }
      residuals.update(next);
      const double enough = f + sufficient * t * slope + residuals.objective_rounding();
      if (residuals.objective() <= enough) break;
    }
    step = t * std::sqrt(2.0 / 3.0 * w.squaredNorm() / graph.num_nodes());
    std::swap(q, next);
  }
  return std::move(monitor).result(to_rotations(q, R));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

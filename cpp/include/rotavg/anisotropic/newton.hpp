#pragma once

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
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>

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

/// Newton's method on general blocks, as solve/newton.hpp. The preconditioner is factored at the
/// start; where it is not positive definite there, coordinate descent goes on instead.
///
/// @param R the initial value, world_from_i, one rotation per node
/// @param eliminations of all components, without their roots
inline IterationResult newton(const AnisotropicGraph& graph, const Rotations& R,
                              std::vector<Elimination>& eliminations,
                              const IterationOptions& options = {}) {
  Monitor monitor(graph.scalar(), R, options);
  Quaternions q = to_quaternions(R);
  AnisotropicResiduals residuals(graph, q, monitor.num_threads());
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
  return newton_iteration(graph, R, std::move(q), residuals, metric, std::move(monitor));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

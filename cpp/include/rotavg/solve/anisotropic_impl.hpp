#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/flat.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/anisotropic.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// r_ij = log(R_ij^T R_i^T R_j).
inline Vector3 anisotropic_residual(const Edge& e, const Rotations& R) {
  return log_so3(transposed_product(product(R[e.i], e.i_from_j()), R[e.j]));
}

/// F and what Gauss and Newton need of it at some rotations.
class AnisotropicLinearization {
 public:
  AnisotropicLinearization(const MeasurementGraph& graph, const std::vector<Matrix3>& information,
                           const Rotations& R)
      : graph_(graph),
        hessian_(graph.edges().size()),
        gradient_(graph.num_nodes(), 3),
        stiffness_(R.size(), 0.0) {
    gradient_.setZero();
    for (std::size_t k = 0; k < hessian_.size(); ++k) {
      const Edge& e = graph.edges()[k];
      const Vector3 r = anisotropic_residual(e, R);
      const Matrix3 A = product_transposed(inverse_right_jacobian(r), R[e.j]);
      const Vector3 pull = product(information[k], r), g = product(transposed(A), pull);
      objective_ += dot(r, pull);
      hessian_[k] = transposed_product(A, product(information[k], A));
      hessian_[k] *= 2.0;
      for (int a = 0; a < 3; ++a) {
        gradient_(e.i, a) -= 2.0 * g(a);
        gradient_(e.j, a) += 2.0 * g(a);
        stiffness_[e.i] += information[k](a, a) / 3.0;
        stiffness_[e.j] += information[k](a, a) / 3.0;
      }
    }
  }

  double objective() const { return objective_; }
  const NodeVectors& gradient() const { return gradient_; }

  /// Relative as of (3): about four times the angle by which a node would turn.
  GradientNorm gradient_norm() const {
    GradientNorm norm{std::sqrt(flat_dot(gradient_, gradient_)), 0.0};
    for (std::size_t i = 0; i < stiffness_.size(); ++i) {
      if (stiffness_[i] == 0.0) continue;
      const Vector3 g = row_of(gradient_, static_cast<Index>(i));
      const double size = std::sqrt(dot(g, g));
      norm.relative = std::max(norm.relative, 2.0 * size / stiffness_[i]);
    }
    return norm;
  }

  BlockCholesky<3>::Blocks hessian(Elimination& elimination) const {
    return elimination.assemble<3>(
        [&](Index i) {
          Matrix3 sum = Matrix3::Zero();
          for (const HalfEdge& h : graph_.row(i)) sum += hessian_[h.edge()];
          return sum;
        },
        [&](Index k) -> Matrix3 { return -hessian_[k]; });
  }

 private:
  const MeasurementGraph& graph_;
  std::vector<Matrix3> hessian_;  // of every edge
  NodeVectors gradient_;
  std::vector<double> stiffness_;
  double objective_ = 0.0;
};

inline double anisotropic_objective(const MeasurementGraph& graph,
                                    const std::vector<Matrix3>& information, const Rotations& R) {
  double sum = 0.0;
  for (std::size_t k = 0; k < information.size(); ++k) {
    const Vector3 r = anisotropic_residual(graph.edges()[k], R);
    sum += dot(r, product(information[k], r));
  }
  return sum;
}

}  // namespace detail

ROTAVG_INLINE IterationResult refine_anisotropic(const MeasurementGraph& graph,
                                                 const std::vector<Matrix3>& information,
                                                 Rotations R, const IterationOptions& options) {
  constexpr int max_halvings = 40;
  constexpr double sufficient = 1e-4;
  if (information.size() != graph.edges().size()) {
    throw std::invalid_argument("found " + std::to_string(information.size()) +
                                " information matrices; expected one for each edge");
  }
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations =
      grounded_eliminations(graph, components, resolve_num_threads(options.num_threads));
  Monitor monitor(graph, R, options);
  double step = 0.0;
  bool settled = false;
  for (;;) {
    const detail::AnisotropicLinearization at_R(graph, information, R);
    if (monitor.should_stop(at_R.objective(), at_R.gradient_norm(), step, settled)) break;

    NodeVectors w = NodeVectors::Zero(graph.num_nodes(), 3);
    for (Elimination& elimination : eliminations) {
      if (elimination.size() == 0) continue;
      BlockCholesky<3> cholesky(elimination.symbolic(), elimination.num_threads());
      const auto outcome =
          cholesky.factorize(at_R.hessian(elimination), 0.0, [&] { return monitor.keep_going(); });
      if (outcome != CholeskyOutcome::positive_definite) continue;  // rounding, or stopped
      Eigen::MatrixXd right(cholesky.size(), 1);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) right(3 * a + k) = -at_R.gradient()(elimination.node(a), k);
      }
      cholesky.solve_in_place(right);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) w(elimination.node(a), k) = right(3 * a + k);
      }
    }

    const double slope = flat_dot(at_R.gradient(), w);
    const double rounding = 1e-14 * at_R.objective();
    settled = true;
    double t = 1.0;
    for (int k = 0; k < max_halvings && slope < 0.0; ++k, t *= 0.5) {
      Rotations next = R;
      for (std::size_t i = 0; i < next.size(); ++i) {
        next[i] = turned(R[i], t * row_of(w, static_cast<Index>(i)));
      }
      const double f = detail::anisotropic_objective(graph, information, next);
      if (f <= at_R.objective() + sufficient * t * slope + rounding) {
        settled = false;
        R = std::move(next);
        break;
      }
    }
    step = settled ? 0.0 : t * std::sqrt(2.0 / 3.0 * flat_dot(w, w) / graph.num_nodes());
  }
  fix_gauge(components, R);
  return std::move(monitor).result(std::move(R));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

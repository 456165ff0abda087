#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/small_inverse.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/riding.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/stopwatch.hpp>
#include <rotavg/solve/truncated_cg.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Nodes that ride on variables with constant rotations and, some of them, with rotations that
/// several share and nobody knows:
///
///     R_i = Q_v(i) K_i C_s(i).
struct SharedRiding {
  Riding riding;              ///< v(i) and K_i
  std::vector<Index> shared;  ///< (n,) s(i); -1: C = I
  Index num_shared = 0;

  Rotations nodes_from(const Rotations& Q, const Rotations& C) const {
    Rotations R = riding.nodes_from(Q);
    for (std::size_t i = 0; i < R.size(); ++i) {
      if (shared[i] >= 0) R[i] = R[i] * C[shared[i]];
    }
    return R;
  }
};

/// What refine_shared() ended with.
struct SharedResult {
  Rotations variables;  ///< Q
  Rotations shared;     ///< C
  /// Of every C, whether the edges tell it: the objective rises in all directions from it.
  std::vector<bool> determined;
  bool converged = false;
  int iterations = 0;
  double objective = 0.0;
  double relative_gradient = 0.0;  ///< largest |gradient| / degree, of variables and shared
};

namespace detail {

/// The Gauss-Newton matrix of refine_shared() for residuals of zero, M = [4 L, B; B^T, D] with L
/// the Laplacian of the variables, by the Schur complement of D: the metric in which f is nearly
/// round.
class SharedMetric {
 public:
  /// @param graph of the nodes
  /// @param laplacian of the variables; null: their degrees instead
  /// @param degrees (variables + shared,)
  SharedMetric(const MeasurementGraph& graph, const SharedRiding& problem,
               LaplacianMetric* laplacian, const Eigen::VectorXd& degrees)
      : graph_(graph), problem_(problem), laplacian_(laplacian), degrees_(degrees) {
    const Index V = problem.riding.num_variables;
    for (Index s = 0; s < problem.num_shared; ++s) {
      if (degrees(V + s) > 0.0) used_.push_back(s);  // another one no node has
    }
  }

  /// @param frame (n,) Q_v(i) K_i
  void update(const Rotations& frame) {
    const Index V = problem_.riding.num_variables, n = static_cast<Index>(frame.size());
    const auto size = static_cast<Index>(3 * used_.size());
    solved_.assign(static_cast<std::size_t>(size), NodeVectors());
    across_ = solved_;
    Eigen::MatrixXd schur(size, size);
    NodeVectors h[3], all;
    for (Index u = 0; u < size; u += 3) {
      for (NodeVectors& of_axis : h) of_axis.setZero(n, 3);
      for (Index i = 0; i < n; ++i) {
        if (problem_.shared[i] == used_[u / 3]) add_column(i, frame[i], h);
      }
      for (Index axis = 0; axis < 3; ++axis) {
        const Index c = u + axis;
        gather(frame, h[axis], all);
        across_[c] = all.topRows(V);
        apply_laplacian(across_[c], solved_[c]);
        for (Index d = 0; d < size; ++d) schur(d, c) = all(V + used_[d / 3], d % 3);
      }
    }
    for (Index c = 0; c < size; ++c) {
      for (Index d = 0; d < size; ++d) {
        schur(c, d) -= across_[c].cwiseProduct(solved_[d]).sum();
      }
    }
    invert(0.5 * (schur + schur.transpose()));
  }

  /// M^-1 r.
  void apply(const NodeVectors& r, NodeVectors& result) {
    const Index V = problem_.riding.num_variables;
    apply_laplacian(r.topRows(V), above_);
    Eigen::VectorXd rest(inverse_.rows());
    for (Index c = 0; c < rest.size(); ++c) {
      rest(c) = r(V + used_[c / 3], c % 3) - across_[c].cwiseProduct(above_).sum();
    }
    rest = inverse_ * rest;
    result.setZero(V + problem_.num_shared, 3);
    for (Index c = 0; c < rest.size(); ++c) {
      above_ -= rest(c) * solved_[c];
      result(V + used_[c / 3], c % 3) = rest(c);
    }
    result.topRows(V) = above_;
  }

  const std::vector<bool>& determined() const { return determined_; }

  /// The transpose of what the variables and C do to the nodes, w_i = w_v(i) + Q_v(i) K_i c_s(i).
  void gather(const Rotations& frame, const NodeVectors& nodes, NodeVectors& all) const {
    const Index V = problem_.riding.num_variables;
    all.setZero(V + problem_.num_shared, 3);
    for (std::size_t i = 0; i < frame.size(); ++i) {
      const auto row = static_cast<Index>(i);
      all.row(problem_.riding.variable[i]) += nodes.row(row);
      if (problem_.shared[i] >= 0) all.row(V + problem_.shared[i]) += nodes.row(row) * frame[i];
    }
  }
  void scatter(const Rotations& frame, const NodeVectors& all, NodeVectors& nodes) const {
    const Index V = problem_.riding.num_variables;
    nodes.resize(static_cast<Index>(frame.size()), 3);
    for (std::size_t i = 0; i < frame.size(); ++i) {
      const auto row = static_cast<Index>(i);
      nodes.row(row) = all.row(problem_.riding.variable[i]);
      if (problem_.shared[i] >= 0) {
        nodes.row(row) += all.row(V + problem_.shared[i]) * frame[i].transpose();
      }
    }
  }

 private:
  /// Adds 4 L w to h[axis], w the columns of Q_v(i) K_i at node i and zero elsewhere.
  void add_column(Index i, const Matrix3& frame, NodeVectors (&h)[3]) const {
    for (const HalfEdge& e : graph_.row(i)) {
      const double weight = 4.0 * e.node_from_l.squaredNorm();
      for (Index axis = 0; axis < 3; ++axis) {
        for (Index k = 0; k < 3; ++k) {
          const double d = weight * frame(k, axis);
          h[axis](i, k) += d;
          h[axis](e.node, k) -= d;
        }
      }
    }
  }

  /// The inverse of the Schur complement, scaled by the degrees; directions that cost nothing are
  /// left alone.
  void invert(Eigen::MatrixXd schur) {
    constexpr double nothing = 1e-9, part = 1e-3;
    const Index V = problem_.riding.num_variables, size = static_cast<Index>(schur.rows());
    Eigen::VectorXd scale(size);
    for (Index c = 0; c < size; ++c) scale(c) = 1.0 / std::sqrt(4.0 * degrees_(V + used_[c / 3]));
    schur = scale.asDiagonal() * schur * scale.asDiagonal();
    determined_.assign(static_cast<std::size_t>(problem_.num_shared), false);
    for (const Index s : used_) determined_[s] = true;
    inverse_ = schur;
    // The trace of the inverse is above that of every eigenvalue alone.
    if (!invert_positive_definite(inverse_) || !(inverse_.trace() < 1.0 / nothing)) {
      const SmallEigen eigen = small_eigen(schur);
      Eigen::VectorXd inverse = Eigen::VectorXd::Zero(size);
      for (Index k = 0; k < size; ++k) {
        if (eigen.values(k) > nothing) {
          inverse(k) = 1.0 / eigen.values(k);
          continue;
        }
        for (Index c = 0; c < size; ++c) {
          if (std::abs(eigen.vectors(c, k)) > part) determined_[used_[c / 3]] = false;
        }
      }
      inverse_ = eigen.vectors * inverse.asDiagonal() * eigen.vectors.transpose();
    }
    inverse_ = scale.asDiagonal() * (0.5 * (inverse_ + inverse_.transpose())) * scale.asDiagonal();
  }

  void apply_laplacian(const NodeVectors& v, NodeVectors& result) {
    if (laplacian_ != nullptr) return laplacian_->apply(v, result);
    result = v;
    for (Index i = 0; i < v.rows(); ++i) {
      if (degrees_(i) > 0.0) result.row(i) /= 4.0 * degrees_(i);
    }
  }

  const MeasurementGraph& graph_;
  const SharedRiding& problem_;
  LaplacianMetric* laplacian_;
  const Eigen::VectorXd& degrees_;
  std::vector<Index> used_;                   // shared rotations of some node
  std::vector<NodeVectors> across_, solved_;  // the columns of B, and of (4 L)^-1 B
  Eigen::MatrixXd inverse_;
  std::vector<bool> determined_;
  NodeVectors above_;
};

}  // namespace detail

/// Descends to a stationary point of f (3) in the variables and the shared rotations together, by
/// Newton's method with conjugate gradients: Q_v <- exp(w_v) Q_v, C_s <- exp(c_s) C_s. Hessian and
/// gradient are those of the nodes, w_i = w_v(i) + Q_v(i) K_i c_s(i); what this leaves out of the
/// Hessian is of the size of the residuals. The objective never rises.
///
/// @param graph of the nodes
/// @param between the graph of the variables; its topology and weights are the metric
/// @param Q, C where it starts
/// @param max_iterations instead of those of the options, which are those of a solve
inline SharedResult refine_shared(const MeasurementGraph& graph, const SharedRiding& problem,
                                  const MeasurementGraph& between, Rotations Q, Rotations C,
                                  const IterationOptions& options = {}, int max_iterations = 100) {
  constexpr double max_flops = 1e10;
  constexpr int max_cg_steps = 50, max_halvings = 30;
  constexpr double sufficient = 1e-4;
  const Stopwatch watch;
  const Index V = problem.riding.num_variables, S = problem.num_shared, n = graph.num_nodes();
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());
  Eigen::VectorXd degrees = Eigen::VectorXd::Zero(V + S);
  for (Index i = 0; i < n; ++i) {
    degrees(problem.riding.variable[i]) += graph.degree(i);
    if (problem.shared[i] >= 0) degrees(V + problem.shared[i]) += graph.degree(i);
  }
  const auto keep_going = [&] {
    return watch.seconds() <= options.time_limit && (!options.keep_going || options.keep_going());
  };
  const Components components = connected_components(between);
  std::vector<Elimination> eliminations = grounded_eliminations(between, components, num_threads);
  LaplacianMetric laplacian(between, eliminations);
  const bool factored = laplacian.flops(max_flops) <= max_flops &&
                        laplacian.factorize(keep_going) == CholeskyOutcome::positive_definite;
  detail::SharedMetric metric(graph, problem, factored ? &laplacian : nullptr, degrees);

  SharedResult result;
  Rotations frame = problem.riding.nodes_from(Q);
  ResidualQuaternions residuals(graph, to_quaternions(problem.nodes_from(Q, C)), num_threads);
  NodeVectors of_nodes(n, 3), H_w(n, 3), g;
  TruncatedCg<NodeVectors> newton_direction;
  for (;; ++result.iterations) {
    for (Index i = 0; i < n; ++i) of_nodes.row(i) = residuals.gradient(i).transpose();
    metric.gather(frame, of_nodes, g);
    result.relative_gradient = 0.0;
    for (Index k = 0; k < V + S; ++k) {
      if (degrees(k) == 0.0) continue;
      result.relative_gradient = std::max(result.relative_gradient, g.row(k).norm() / degrees(k));
    }
    metric.update(frame);
    result.converged = result.relative_gradient <= options.tolerance;
    if (result.converged || result.iterations == max_iterations || !keep_going()) break;
    const double forcing = std::min(0.1, std::sqrt(result.relative_gradient));
    const NodeVectors& w = newton_direction(
        g, forcing, max_cg_steps, num_threads,
        [&](const NodeVectors& p, NodeVectors& Hp) {
          metric.scatter(frame, p, of_nodes);
          apply_hessian(residuals, of_nodes, H_w);
          metric.gather(frame, H_w, Hp);
        },
        [&](const NodeVectors& r, NodeVectors& z) { metric.apply(r, z); });
    const double f = residuals.objective();
    Rotations next_Q(Q), next_C(C);
    const auto falls_along = [&](const NodeVectors& direction) {
      const double slope = g.cwiseProduct(direction).sum();
      bool fell = false;
      double t = 1.0;
      for (int k = 0; k < max_halvings && !fell && slope < 0.0; ++k, t *= 0.5) {
        for (Index v = 0; v < V; ++v) next_Q[v] = exp_so3(t * direction.row(v).transpose()) * Q[v];
        for (Index s = 0; s < S; ++s) {
          next_C[s] = exp_so3(t * direction.row(V + s).transpose()) * C[s];
        }
        residuals.update(to_quaternions(problem.nodes_from(next_Q, next_C)));
        fell = residuals.objective() <= f + sufficient * t * slope + residuals.objective_rounding();
      }
      return fell;
    };
    const auto steepest = [&] {
      NodeVectors z;
      metric.apply(g, z);
      return NodeVectors(-z);
    };
    // With gravity a turn about the vertical may cost almost nothing, and its part of a Newton step
    // be rounding alone.
    if (!falls_along(w) && !falls_along(steepest())) {
      residuals.update(to_quaternions(problem.nodes_from(Q, C)));
      break;
    }
    Q = std::move(next_Q);
    C = std::move(next_C);
    frame = problem.riding.nodes_from(Q);
  }
  for (Matrix3& R : Q) R = nearest_rotation(R);
  for (Matrix3& R : C) R = nearest_rotation(R);
  result.variables = std::move(Q);
  result.shared = std::move(C);
  result.determined = metric.determined();
  result.objective = residuals.objective();
  return result;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

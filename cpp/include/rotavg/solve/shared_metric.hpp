#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/small_inverse.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/reduction/shared_riding.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

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

}  // namespace rotavg

#pragma GCC diagnostic pop

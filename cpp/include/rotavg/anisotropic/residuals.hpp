#pragma once

#include <cmath>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The paper's A_l (10) for general blocks, so that 2 tr(A_l R_l) is the part of f that depends on
/// R_l: A_l = - sum_q Rt_lq R_q^T.
inline Matrix3 linear_cost(const AnisotropicGraph& graph, const Rotations& R, Index l) {
  Matrix3 A = Matrix3::Zero();
  for (const HalfEdge& h : graph.row(l)) A -= product_transposed(graph.block(h), R[h.node]);
  return A;
}

/// What is known of an edge at some rotations, in the global frame. With G = R_i N R_j^T, sym and
/// skew its symmetric and antisymmetric part,
///
///     T = tr(G) I - sym(G),     [p] = skew(G).
///
/// T is the precision that is felt there (R_j H R_j^T where the edge fits), and 4 p the gradient.
///
/// Where f is flat about an axis a (FreeAxis), T has tr(H) / 4 a a^T besides, as if that were known
/// there, too: no step of Newton's method is wasted on it, and it costs a proof nothing. For any
/// rotations, those of the part turned about a so that X = R_i' R_i^T turns about an axis u across
/// a cost the same; and of these alone a split asks for u^T Q u >= 0 (anisotropic/split.hpp), where
/// -tr(H) / 4 a a^T in Q is zero.
struct EdgeForce {
  Matrix3 T;
  Vector3 p;
  double cost;  ///< what the edge adds to the objective
  double sine;  ///< |v|, of half the residual angle
};

/// All edges at some rotations.
///
///     objective      4 v^T H v, (v, s) the unit quaternion of E = R_i R_ij R_j^T, H turned by R_j
///     gradient       4 p at i, -4 p at j,     p = s H v + v x H v
///     Hessian        2 T at ii and jj, -2 (T + [p]) at ij
///     certificate    anisotropic/split.hpp
///
/// The objective is exact to a few roundings of v, however small it is, and so is p where H is far
/// from singular.
class AnisotropicResiduals {
 public:
  /// @param graph must outlive this object
  /// @param q world_from_i, one unit quaternion per node
  AnisotropicResiduals(const AnisotropicGraph& graph, const Quaternions& q, int num_threads)
      : graph_(&graph), num_threads_(num_threads), force_(graph.precisions().size()) {
    update(q);
  }

  /// Moves to other rotations.
  void update(const Quaternions& q) {
    const auto& edges = graph_->scalar().edges();
    const auto& quaternion_edges = graph_->scalar().quaternion_edges();
    objective_ = block_sum<double>(graph_->num_edges(), num_threads_, [&](Index k) {
      const Vector4 e = residual_quaternion(quaternion_edges[k], q) / std::sqrt(edges[k].weight);
      const Vector3 v = e.head<3>();
      const Matrix3 R_j = weighted_rotation(q[edges[k].j]);
      const Matrix3 H = product_transposed(R_j * graph_->precisions()[k], R_j);
      const Vector3 Hv = H * v;
      // G = M + 2 s [v] M + 2 [v]^2 M, M = tr(H) / 2 I - H
      Matrix3 M = -H;
      add_to_diagonal(M, 0.5 * H.trace());
      const Matrix3 G = weighted_rotation(Quaternion(e)) * M;
      force_[k].T = -symmetric_part(G);
      add_to_diagonal(force_[k].T, G.trace());
      force_[k].p = e.w() * Hv + cross(v, Hv);
      force_[k].sine = v.norm();
      const Matrix3* const A = graph_->root(k);
      double square = std::max(v.dot(Hv), 0.0);
      if (A) {
        const Vector3 v_j = R_j.transpose() * v, known = *A * v_j;
        square = known.squaredNorm();
      }
      return force_[k].cost = 4.0 * square;
    });
    for (const FreeAxis& free : graph_->free_axes()) {
      const Vector3 a = product(weighted_rotation(q[edges[free.edge].j]), free.axis);
      add(force_[free.edge].T,
          outer_product(0.25 * graph_->precisions()[free.edge].trace() * a, a));
    }
  }

  const AnisotropicGraph& graph() const { return *graph_; }
  int num_threads() const { return num_threads_; }
  /// (m,)
  const LargeVector<EdgeForce>& operator()() const { return force_; }
  double objective() const { return objective_; }
  /// How much rounding can have moved the objective: H is at most its trace, six weights.
  double objective_rounding() const {
    return 4.0 * rotavg::objective_rounding(6.0 * graph_->scalar().total_weight(), objective_);
  }

  /// The gradient of f at node l in the global frame, R_l <- exp(w) R_l.
  Vector3 gradient(Index l) const {
    Vector3 sum = Vector3::Zero();
    for (const HalfEdge& h : graph_->row(l)) {
      const Vector3& p = force_[h.edge()].p;
      if (h.is_i()) {
        sum += p;
      } else {
        sum -= p;
      }
    }
    return 4.0 * sum;
  }

  /// Relative to the scalar weights: about four times the angle by which a node would turn.
  GradientNorm gradient_norm() const {
    const auto sums = block_sum<GradientSums>(graph_->num_nodes(), num_threads_, [&](Index l) {
      if (graph_->row(l).size() == 0) return GradientSums{};
      const double square = gradient(l).squaredNorm();
      return GradientSums{square, std::sqrt(square) / graph_->degree(l)};
    });
    return {std::sqrt(sums.squares), sums.largest};
  }

 private:
  const AnisotropicGraph* graph_;
  int num_threads_;
  LargeVector<EdgeForce> force_;
  double objective_ = 0.0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

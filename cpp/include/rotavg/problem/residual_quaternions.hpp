#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lanes.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// sqrt(w) times the unit quaternion of R_i R_ij R_j^T.
inline Vector4 residual_quaternion(const QuaternionEdge& edge, const Quaternions& q) {
  const WeightedQuaternion j_estimate(product(q[edge.i], edge.i_from_j));
  return product(j_estimate, WeightedQuaternion(conjugated(q[edge.j])));
}

/// The same of four edges, by their numbers: e[0] holds their x, e[1] their y, and so on.
EIGEN_STRONG_INLINE void residual_quaternions_of_four(const MeasurementGraph& graph,
                                                      const Quaternions& q, const Index (&edge)[4],
                                                      Lanes (&e)[4]) {
  Lanes q_i[4], q_j[4], i_from_j[4], estimate[4];
  for (int a = 0; a < 4; ++a) {
    const QuaternionEdge& edge_a = graph.quaternion_edges()[static_cast<std::size_t>(edge[a])];
    std::memcpy(&i_from_j[a], edge_a.i_from_j.coeffs().data(), sizeof(Lanes));
    std::memcpy(&q_i[a], q[static_cast<std::size_t>(edge_a.i)].coeffs().data(), sizeof(Lanes));
    std::memcpy(&q_j[a], q[static_cast<std::size_t>(edge_a.j)].coeffs().data(), sizeof(Lanes));
  }
  transpose(i_from_j);
  transpose(q_i);
  transpose(q_j);
  multiply_four(q_i, i_from_j, estimate);
  for (int a = 0; a < 3; ++a) q_j[a] = -q_j[a];
  multiply_four(estimate, q_j, e);
}

/// The objective (3) without storing anything.
inline double objective(const MeasurementGraph& graph, const Quaternions& q, int num_threads) {
  return block_sum<double>(graph.num_edges(), num_threads, [&](Index k) {
    prefetch_ahead(graph.quaternion_edges(), k);
    return 8.0 * vector_square(residual_quaternion(graph.quaternion_edges()[k], q));
  });
}

/// What every edge leaves over, in the global frame: sqrt(w) times the unit quaternion e = (v, s)
/// of
///
///     E_ij = R_i R_ij R_j^T,
///
/// the identity where the edge fits. All that the solvers and the certificate need is short in it:
///
///     objective      w |R_i R_ij - R_j|_F^2 = 8 |v|^2                                      (3)
///     gradient       8 s v at i, -8 s v at j
///     Hessian        problem/hessian.hpp
///     certificate    certify/certificate_matrix.hpp
class ResidualQuaternions {
 public:
  /// @param graph must outlive this object
  /// @param q world_from_i, one unit quaternion per node
  ResidualQuaternions(const MeasurementGraph& graph, const Quaternions& q, int num_threads)
      : graph_(&graph), num_threads_(num_threads), e_(graph.edges().size()) {
    update(q);
  }

  /// Moves to other rotations.
  void update(const Quaternions& q) {
    objective_ = block_sum<double>(graph_->num_edges(), num_threads_, [&](Index k) {
      prefetch_ahead(graph_->quaternion_edges(), k);
      e_[k] = residual_quaternion(graph_->quaternion_edges()[k], q);
      return 8.0 * vector_square(e_[k]);
    });
  }

  const MeasurementGraph& graph() const { return *graph_; }
  int num_threads() const { return num_threads_; }
  /// (m,) x, y, z, w of every edge.
  const LargeVector<Vector4>& operator()() const { return e_; }
  double objective() const { return objective_; }
  /// How much rounding can have moved the objective.
  double objective_rounding() const { return rotavg::objective_rounding(*graph_, objective_); }

  /// The gradient of f at node l in the global frame, R_l <- exp(w) R_l.
  Vector3 gradient(Index l) const {
    Vector3 sum(0.0, 0.0, 0.0);
    for (const HalfEdge& h : graph_->row(l)) {
      const Vector4& e = e_[h.edge()];
      const double s = h.is_i() ? e.w() : -e.w();
      for (int k = 0; k < 3; ++k) sum(k) += s * e(k);
    }
    return {8.0 * sum(0), 8.0 * sum(1), 8.0 * sum(2)};
  }

  GradientNorm gradient_norm() const {
    const auto sums = block_sum<GradientSums>(graph_->num_nodes(), num_threads_, [&](Index l) {
      if (graph_->row(l).size() == 0) return GradientSums{};
      const Vector3 g = gradient(l);
      const double square = dot(g, g);
      return GradientSums{square, std::sqrt(square) / graph_->degree(l)};
    });
    return {std::sqrt(sums.squares), sums.largest};
  }

 private:
  const MeasurementGraph* graph_;
  int num_threads_;
  LargeVector<Vector4> e_;
  double objective_ = 0.0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cmath>
#include <vector>

#include <rotavg/graph/half_edge_rows.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/problem/sums_at_nodes.hpp>
#include <rotavg/so3/lanes.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A sum of p p^T over products p = q b of quaternions, four numbers in a register: the inner loop
/// of all sweeps.
class DavenportSum {
 public:
  /// Adds p p^T for p = q b.
  EIGEN_STRONG_INLINE void add(const Quaternion& q, const WeightedQuaternion& b) {
    Lanes p;
    multiply(q, b, p);
    same_ += p * p;
    next_ += p * Lanes{p[1], p[2], p[3], p[0]};
    opposite_ += p * Lanes{p[2], p[3], p[0], p[1]};
  }
  DavenportSum& operator+=(const DavenportSum& other) {
    same_ += other.same_;
    next_ += other.next_;
    opposite_ += other.opposite_;
    return *this;
  }
  Matrix4 matrix() const {
    Matrix4 K;
    for (int k = 0; k < 4; ++k) {
      const int next = (k + 1) % 4, opposite = (k + 2) % 4;
      K(k, k) = same_[k];
      K(k, next) = K(next, k) = next_[k];
      K(k, opposite) = opposite_[k];
    }
    return K;
  }

 private:
  Lanes same_ = {}, next_ = {},
        opposite_ = {};  // products of x, y, z, w with x, y, z, w; y, z, w, x; …
};

/// The paper's A_l (10) in quaternions: K_l = sum p p^T over the neighbours' estimates p of R_l, so
/// that for a unit q
///
///     tr(A_l R(q)) = deg_l - 4 q^T K_l q.
///
/// @tparam Rows MeasurementGraph or HalfEdgeRows
template <typename Rows>
Matrix4 davenport_matrix(const Rows& rows, const Quaternions& q, Index l) {
  DavenportSum K;
  for (const HalfEdge& h : rows.row(l)) K.add(q[h.node], h.node_from_l);  // R_l ~ R_q R_ql
  return K.matrix();
}

/// Asks the memory for what K_l will be made of, which on large graphs lies far apart.
inline void prefetch_row(const MeasurementGraph& graph, const Quaternions& q, Index l) {
  if (!is_far(graph.quaternion_edges())) return;
  for (const HalfEdge& h : graph.row(l)) {
    prefetch_object(graph.quaternion_edges()[h.edge()].i_from_j);
    prefetch_object(q[h.node]);
  }
}
/// The same of rows that are read in order.
inline void prefetch_row(const HalfEdgeRows& rows, const Quaternions& q, Index l) {
  if (!is_far(q)) return;
  for (const HalfEdge& h : rows.row(l)) prefetch_object(q[h.node]);
}

/// K_l of all nodes, with the objective and the gradient, in one pass over the measurements.
class DavenportMatrices {
 public:
  /// @param graph must outlive this object
  /// @param q world_from_i, one unit quaternion per node
  DavenportMatrices(const MeasurementGraph& graph, const Quaternions& q, int num_threads)
      : graph_(&graph), num_threads_(num_threads), K_(q.size(), Matrix4::Zero()) {
    // Sums of q terms of one sign can round the same way every time.
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      difference_rounding_ += 1e-15 * (graph.row(l).size() + 8.0) * graph.degree(l);
    }
    update(q);
  }

  /// Moves to other rotations.
  void update(const Quaternions& q) {
    const MeasurementGraph& graph = *graph_;
    const auto& edges = graph.quaternion_edges();
    const auto K = sums_at_nodes<DavenportSum>(
        graph, num_threads_,
        [&](const HalfEdge& h, DavenportSum& sum) { sum.add(q[h.node], h.node_from_l); },
        [&](Index k, DavenportSum& at_i, DavenportSum& at_j) {
          const QuaternionEdge& e = edges[k];
          at_i.add(q[e.j], e.i_from_j.conjugate());
          at_j.add(q[e.i], e.i_from_j);
        });
    const auto sums = block_sum<Sums>(graph.num_nodes(), num_threads_, [&](Index l) {
      if (graph.row(l).size() == 0) return Sums{};
      K_[l] = K[l].matrix();
      const Vector4 Kq = K_[l] * q[l].coeffs();
      // 8 (K q) q^-1: the vector part is minus the gradient
      const double norm = 8.0 * product(Quaternion(Kq), q[l].conjugate()).head<3>().norm();
      return Sums{4.0 * (graph.degree(l) - q[l].coeffs().dot(Kq)),  // each edge counts at both ends
                  {norm * norm, norm / graph.degree(l)}};
    });
    gradient_ = {std::sqrt(sums.gradient.squares), sums.gradient.largest};
    objective_ = sums.objective;
    objective_rounding_ = difference_rounding_;
    if (!(objective_ > 1e9 * objective_rounding_)) {  // too few digits are left of the difference
      objective_ = rotavg::objective(graph, q, num_threads_);
      objective_rounding_ = rotavg::objective_rounding(graph, objective_);
    }
  }

  const Matrix4& operator[](Index l) const { return K_[l]; }
  double objective() const { return objective_; }
  /// How much rounding can have moved the objective.
  double objective_rounding() const { return objective_rounding_; }
  const GradientNorm& gradient_norm() const { return gradient_; }

 private:
  struct Sums {
    double objective = 0.0;
    GradientSums gradient;
    Sums& operator+=(const Sums& other) {
      objective += other.objective;
      gradient += other.gradient;
      return *this;
    }
  };

  const MeasurementGraph* graph_;
  int num_threads_;
  std::vector<Matrix4> K_;
  double objective_ = 0.0, objective_rounding_ = 0.0, difference_rounding_ = 0.0;
  GradientNorm gradient_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

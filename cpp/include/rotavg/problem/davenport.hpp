#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// The paper's A_l (10) in quaternions: K_l = sum p p^T over the neighbours' estimates p of R_l, so
/// that for a unit q
///
///     tr(A_l R(q)) = deg_l - 4 q^T K_l q.
inline Matrix4 davenport_matrix(const MeasurementGraph& graph, const Quaternions& q, Index l) {
  Matrix4 K = Matrix4::Zero();
  for (const HalfEdge& h : graph.row(l)) {
    const Vector4 p = product(q[h.node], h.node_from_l);  // R_l ~ R_q R_ql, times sqrt(w)
    K += p * p.transpose();
  }
  return K;
}

/// K_l of all nodes, with the objective and the gradient, in one pass over the measurements.
struct DavenportMatrices {
  std::vector<Matrix4> K;
  double objective = 0.0;
  GradientNorm gradient;

  void update(const MeasurementGraph& graph, const Quaternions& q, int num_threads) {
    K.resize(q.size());
    const auto sums = block_sum<Sums>(graph.num_nodes(), num_threads, [&](Index l) {
      Matrix4 K_l = Matrix4::Zero();
      const Vector4 q_l = q[l].coeffs();
      double squares = 0.0;
      for (const HalfEdge& h : graph.row(l)) {
        const Vector4 p = product(q[h.node], h.node_from_l);
        K_l += p * p.transpose();
        squares += (p - p.dot(q_l) * q_l).squaredNorm();
      }
      K[l] = K_l;
      Sums at_node;
      at_node.objective = 4.0 * squares;  // each edge twice
      if (graph.row(l).size() > 0) {
        // sum 8 (p . q) p q^-1, whose vector part is minus the gradient
        const Vector4 p(8.0 * (K_l * q_l));
        const double norm = product(Quaternion(p), q[l].conjugate()).head<3>().norm();
        at_node.gradient = {norm * norm, norm / graph.degree(l)};
      }
      return at_node;
    });
    objective = sums.objective;
    gradient = {std::sqrt(sums.gradient.squares), sums.gradient.largest};
  }

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
};

}  // namespace rotavg

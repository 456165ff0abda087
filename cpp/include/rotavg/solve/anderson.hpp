#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Anderson's mixing (Anderson 1965) of a fixed-point iteration q <- step(q), in the space of free
/// quaternions and then back to length one. From the last few iterates it predicts, as if the step
/// were affine, where in their affine hull the residual step(q) - q would be least, and steps from
/// there.
///
/// The differences of the residuals are kept orthonormal (Tang, Xu, He, Saad and Xi 2024, "Anderson
/// acceleration with truncated Gram-Schmidt"), in the inner product that weights nodes by their
/// degrees. Near a solution with small residuals the step of SUM is self-adjoint in it, so that a
/// few pairs do what all iterates together would: the method is that of conjugate residuals. Sweeps
/// of BCD to and fro are self-adjoint in a similar one, sweeps in one direction in none.
class AndersonMixing {
 public:
  /// @param graph must outlive this object
  AndersonMixing(const MeasurementGraph& graph, int num_threads)
      : graph_(graph),
        num_threads_(threads_for_nodes(resolve_num_threads(num_threads), graph.num_nodes())) {
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      max_degree_ = std::max(max_degree_, graph.degree(l));
    }
  }

  /// Takes note of next = step(q), and predicts from all it has noted.
  /// @param mixed receives the prediction; a node without edges keeps its rotation
  /// @returns whether there was enough to predict from
  bool mix(const Quaternions& q, const Quaternions& next, Quaternions& mixed) {
    Columns x(q.size()), residual(q.size());
    for_nodes([&](Index l) {
      x[l] = q[l].coeffs();
      residual[l] = same_sign(next[l], q[l]) - x[l];
    });
    if (!last_x_.empty()) add_pair(x, residual);
    last_x_.swap(x);
    last_residual_.swap(residual);
    if (pairs_.empty()) return false;

    std::vector<double> theta;
    for (const Pair& pair : pairs_) theta.push_back(inner(pair.r, last_residual_));
    mixed.resize(q.size());
    for_nodes([&](Index l) {
      Vector4 y = last_x_[l] + last_residual_[l];
      for (std::size_t k = 0; k < theta.size(); ++k) {
        const Vector4 change = pairs_[k].u[l] + pairs_[k].r[l];
        y -= theta[k] * change;
      }
      const bool usable = graph_.row(l).size() > 0 && y.squaredNorm() > 0.01;
      mixed[l] = usable ? Quaternion(y).normalized() : next[l];
    });
    return true;
  }

 private:
  using Columns = std::vector<Vector4>;  ///< one for each node
  /// Where the iterate changes by u, the residual changes by r, |r| = 1.
  struct Pair {
    Columns u, r;
  };
  /// Even, as the steps of SUM on a bipartite graph have eigenvalues in pairs, +s and -s.
  static constexpr std::size_t max_pairs = 4;

  /// q and -q are the same rotation.
  static Vector4 same_sign(const Quaternion& q, const Quaternion& as) {
    Vector4 y = q.coeffs();
    if (y.dot(as.coeffs()) < 0.0) y *= -1.0;
    return y;
  }

  void add_pair(const Columns& x, const Columns& residual) {
    Pair pair{Columns(x.size()), Columns(x.size())};
    Columns &u = pair.u, &r = pair.r;  // lambdas of C++17 capture no structured binding
    for_nodes([&](Index l) {
      u[l] = x[l] - last_x_[l];
      r[l] = residual[l] - last_residual_[l];
      if (x[l].dot(last_x_[l]) < 0.0) {  // the sign has changed
        u[l] = x[l] + last_x_[l];
        r[l] = residual[l] + last_residual_[l];
      }
    });
    const double size = std::sqrt(inner(r, r));
    for (const Pair& other : pairs_) {
      const double s = inner(r, other.r);
      for_nodes([&](Index l) {
        u[l] -= s * other.u[l];
        r[l] -= s * other.r[l];
      });
    }
    const double left = std::sqrt(inner(r, r));
    if (!(left > 1e-10 * size)) return;  // it says nothing new
    for_nodes([&](Index l) {
      u[l] /= left;
      r[l] /= left;
    });
    if (pairs_.size() == max_pairs) pairs_.pop_front();
    pairs_.push_back(std::move(pair));
  }

  double inner(const Columns& A, const Columns& B) const {
    return block_sum<double>(graph_.num_nodes(), num_threads_, [&](Index l) {
      return graph_.degree(l) / max_degree_ * A[l].dot(B[l]);
    });
  }

  template <typename Function>
  void for_nodes(Function&& f) const {
    parallel_for(graph_.num_nodes(), num_threads_, f);
  }

  const MeasurementGraph& graph_;
  int num_threads_;
  double max_degree_ = 0.0;
  Columns last_x_, last_residual_;
  std::deque<Pair> pairs_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

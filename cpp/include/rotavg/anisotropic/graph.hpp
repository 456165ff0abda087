#pragma once

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/problem/check_precisions.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// An axis about which f is flat: whatever an edge joins to the first node of its component may
/// turn about it, as all that gravity alone holds about down. (Only one such edge of each part.)
struct FreeAxis {
  Index edge;
  Vector3 axis;  ///< of length 1, in the frame of j, which is that first node
};

/// Measurements that know some axes better than others. With H_ij >= 0 the precision (inverse
/// covariance, radians^-2) of the error r = log(R_ij^T R_i^T R_j), in the frame of j,
///
///     f(R) = sum 2 (tr M - tr(R_i N_ij R_j^T)),     N = R_ij M,     M = tr(H) / 2 I - H:
///
/// the paper's (20) with general 3 x 3 blocks N_ij in Rt instead of w_ij R_ij. An edge costs 4 v^T
/// H v with v = sin(|r| / 2) r / |r|, which is r^T H r for small r; H = h I is the weight h / 2.
class AnisotropicGraph {
 public:
  /// @param graph whose weights do not count
  /// @param precisions (m,) H of every edge; they may be singular, but not zero
  /// @param free_axes of edges whose precision about that axis is zero
  /// @throws InvalidEdge for one that is not finite, symmetric and positive semidefinite
  /// @throws std::invalid_argument unless there is one for each edge, and for a free axis of none
  AnisotropicGraph(MeasurementGraph graph, std::vector<Matrix3> precisions,
                   std::vector<FreeAxis> free_axes = {})
      : scalar_(std::move(graph)),
        precisions_(std::move(precisions)),
        free_axes_(std::move(free_axes)) {
    if (precisions_.size() != scalar_.edges().size()) {
      throw std::invalid_argument("found " + std::to_string(precisions_.size()) +
                                  " precisions; expected " +
                                  std::to_string(scalar_.edges().size()) + ", one for each edge");
    }
    std::vector<double> weights;
    blocks_.reserve(precisions_.size());
    weights.reserve(precisions_.size());
    for (Index k = 0; k < num_edges(); ++k) {
      const Vector3 axes = checked_precision(k, precisions_[k]);
      unevenness_ += std::min(most_uneven, std::sqrt(axes(2) / std::max(axes(0), 0.0)));
      if (!(axes(0) > nearly_singular * axes(2))) {
        if (root_of_.empty()) root_of_.assign(precisions_.size(), -1);
        root_of_[k] = static_cast<Index>(roots_.size());
        roots_.push_back(root_of(precisions_[k]));
      }
      weights.push_back(precisions_[k].trace() / 6.0);
      Matrix3 M = -precisions_[k];
      add_to_diagonal(M, 3.0 * weights.back());
      blocks_.push_back(product(scalar_.edges()[k].i_from_j(), M));
    }
    for (const FreeAxis& free : free_axes_) {
      if (free.edge >= 0 && free.edge < num_edges()) continue;
      throw std::invalid_argument("a free axis is of edge " + std::to_string(free.edge) +
                                  ", and the graph has " + std::to_string(num_edges()));
    }
    scalar_.set_weights(weights);
    unevenness_ /= std::max<double>(num_edges(), 1.0);
  }

  /// The same measurements with the weights tr(H) / 6, whose objective is the mean of f over all
  /// turns of the precisions: it has the ends of the edges, starts and metrics.
  const MeasurementGraph& scalar() const { return scalar_; }
  Index num_nodes() const { return scalar_.num_nodes(); }
  Index num_edges() const { return scalar_.num_edges(); }
  HalfEdges row(Index l) const { return scalar_.row(l); }
  /// Sum of the scalar weights at node l.
  double degree(Index l) const { return scalar_.degree(l); }

  /// (m,) H.
  const std::vector<Matrix3>& precisions() const { return precisions_; }
  /// A with A^T A = H where H is nearly singular, without what rounding leaves of eigenvalues that
  /// are zero; else null. There v^T H v is |A v|^2, as v may be long along the axes that are not
  /// known (the heading of an edge of gravity) and H rounds by more than what the others cost.
  const Matrix3* root(Index k) const {
    return root_of_.empty() || root_of_[k] < 0 ? nullptr : &roots_[root_of_[k]];
  }
  /// How far H is from a multiple of I: the root of its largest eigenvalue over its least, the mean
  /// over the edges, of which each counts as at most 10; 1 where all axes are known alike.
  double unevenness() const { return unevenness_; }
  const std::vector<FreeAxis>& free_axes() const { return free_axes_; }
  /// The block Rt_lq of a half-edge of node l.
  Matrix3 block(const HalfEdge& h) const {
    const Matrix3& N = blocks_[h.edge()];
    return h.is_i() ? N : transposed(N);
  }

 private:
  static Matrix3 root_of(const Matrix3& H) {
    constexpr double zero = 1e-14;  // of the largest eigenvalue
    const SymmetricEigen eigen = symmetric_eigen(H);
    Matrix3 A = transposed(eigen.vectors);
    for (int k = 0; k < 3; ++k) {
      const double value = eigen.values(k);
      A.row(k) *= value > zero * eigen.values(2) ? std::sqrt(value) : 0.0;
    }
    return A;
  }

  MeasurementGraph scalar_;
  std::vector<Matrix3> precisions_;
  std::vector<FreeAxis> free_axes_;
  std::vector<Matrix3> blocks_;  ///< N
  std::vector<Index> root_of_;   ///< (m,) of the edges that have a root, or -1; empty without any
  std::vector<Matrix3> roots_;
  static constexpr double most_uneven = 10.0, nearly_singular = 1e-6;
  double unevenness_ = 0.0;
};

/// Any block N_ij of Rt as a rotation and a precision: R_ij is the rotation nearest to N, and with
/// M = sym(R_ij^T N) the precision is H = tr(M) I - M, which is never negative. (Registered point
/// clouds: N = sum a b^T over points a, b of i and j.)
struct BlockMeasurement {
  Matrix3 i_from_j;
  Matrix3 precision;
};
inline BlockMeasurement measurement_from_block(const Matrix3& N) {
  const Matrix3 R = nearest_rotation(N);
  const Matrix3 M = symmetric_part(transposed_product(R, N));
  Matrix3 H = -M;
  add_to_diagonal(H, M.trace());
  return {R, H};
}

}  // namespace rotavg

#pragma GCC diagnostic pop

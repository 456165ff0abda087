#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// That S of a component was at least `cut` D on the complement of its null vectors at some
/// rotations, which holds near them, too: a certificate at the next iterate needs no new proof.
///
/// In the global frame, where the complement is the same at all rotations: where none has moved by
/// more than delta (as a matrix, but for a common turn, which changes nothing), no block E_ij has
/// moved by more than 2 w delta, and by block rows S by no more than 4 delta D.
class KnownCut {
 public:
  void remember(const CertificateMatrix& S, const Quaternions& q, double cut) {
    cut_ = cut;
    world_from_node_.clear();
    world_from_node_.reserve(S.nodes().size());
    for (const Index i : S.nodes()) world_from_node_.push_back(q[i]);
  }

  /// What S at q is at least, of the same component, edges and weights; zero where less than half
  /// of the cut is left: the gap is divided by it, and a new proof is worth its time.
  double at(const CertificateMatrix& S, const Quaternions& q) const {
    if (world_from_node_.empty()) return 0.0;
    constexpr double rounding = 1e-14;  // of the rotations of quaternions
    constexpr double least = 0.5;
    const Quaternion turn(product(q[S.nodes()[0]], world_from_node_[0].conjugate()));
    double delta = 0.0;
    for (Index a = 0; a < S.num_nodes(); ++a) {
      const Quaternion turned_along(product(turn, world_from_node_[a]));
      delta = std::max(delta, chordal_distance(q[S.nodes()[a]], turned_along) / std::sqrt(2.0));
    }
    const double cut = cut_ - 4.0 * (delta + rounding);
    return cut > least * cut_ ? cut : 0.0;
  }

 private:
  double cut_ = 0.0;
  Quaternions world_from_node_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

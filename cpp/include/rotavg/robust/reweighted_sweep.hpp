#pragma once

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/davenport.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/loss_of_four.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/so3/lanes.hpp>
#include <rotavg/so3/loso_quaternion.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/monitor.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// DavenportSum over estimates p = q b of a rotation r, each of which counts as much as a loss
/// leaves of its weight, with its residual in units of its precision; four of them at a time.
class ReweightedDavenportSum {
 public:
  ReweightedDavenportSum(const Quaternion& r, const RobustLoss& loss) : r_(r), loss_(loss) {}

  EIGEN_STRONG_INLINE void add(const Quaternion& q, const WeightedQuaternion& b, double precision) {
    precision_[count_] = precision;
    multiply(q, b, p_[count_++]);
    if (count_ == 4) add_four();
  }
  Matrix4 matrix() {
    if (count_ > 0) {
      while (count_ < 4) p_[count_++] = Lanes{};
      add_four();
    }
    Matrix4 K;
    for (int a = 0, k = 0; a < 4; ++a) {
      for (int b = 0; b <= a; ++b, ++k) {
        const Lanes& s = sums_[k];
        K(a, b) = K(b, a) = (s[0] + s[1]) + (s[2] + s[3]);
      }
    }
    return K;
  }

 private:
  EIGEN_STRONG_INLINE void add_four() {
    constexpr double tiny = 1e-300;  // for those that are not there
    transpose(p_);
    const Lanes cosine = r_.x() * p_[0] + r_.y() * p_[1] + r_.z() * p_[2] + r_.w() * p_[3];
    Lanes off2{}, weight{};
    for (int a = 0; a < 4; ++a) {
      const Lanes off = p_[a] - cosine * r_.coeffs()[a];
      off2 += off * off;
      weight += p_[a] * p_[a];
    }
    const Lanes x = 4.0 * off2 / (weight + tiny);
    Lanes share;
    weight_shares(loss_, x, precision_, share);
    for (int a = 0, k = 0; a < 4; ++a) {
      const Lanes weighted = share * p_[a];
      for (int b = 0; b <= a; ++b, ++k) sums_[k] += weighted * p_[b];
    }
    count_ = 0;
  }

  const Quaternion r_;
  const RobustLoss loss_;
  Lanes p_[4];  // each estimate, then each of x, y, z, w
  Lanes precision_{};
  int count_ = 0;
  Lanes sums_[10] = {};  // of products of two of x, y, z, w
};

/// One sweep of block coordinate descent (bcd_sweep) on the robust objective, in place: before a
/// node moves, its edges get the weights that their residuals ask for now. As those bound the
/// objective from above, it never rises; and as they are newer than weights held through a sweep,
/// fewer sweeps do. Ends early where the monitor does not let it go on.
///
/// @param residuals whose loss and precisions it takes; they stay where they were
inline void reweighted_sweep(const RobustResiduals& residuals, Quaternions& q,
                             const Monitor& monitor) {
  constexpr Index nodes_between_questions = 4096;
  const MeasurementGraph& graph = residuals.graph();
  for (Index l = 0; l < graph.num_nodes(); ++l) {
    if (l + 1 < graph.num_nodes()) prefetch_row(graph, q, l + 1);
    if (graph.row(l).size() == 0) continue;
    ReweightedDavenportSum K(q[l], residuals.loss());
    for (const HalfEdge& h : graph.row(l)) {
      K.add(q[h.node], h.node_from_l, precision_of(residuals.precision(), h.edge()));
    }
    q[l] = loso(K.matrix(), q[l]);
    if (l % nodes_between_questions == 0 && !monitor.keep_going()) break;
  }
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// tr(A) / 2 I - A. The inverse of that is A -> tr(A) I - A.
inline Matrix3 half_trace_less(const Matrix3& A) {
  Matrix3 result = -A;
  add_to_diagonal(result, 0.5 * A.trace());
  return result;
}

/// What the closed form gives up of a precision T, see EdgeSplits.
inline Matrix3 closed_form_split(const Matrix3& T) {
  constexpr double share = 0.2;  // of m2 + m3, to m3
  const SymmetricEigen eigen = symmetric_eigen(half_trace_less(T));
  const double m3 = eigen.values(0), m2 = eigen.values(1);
  const double c = share * std::max(0.0, m2 + m3) - m3;
  if (!(c > 0.0)) return Matrix3::Zero();
  const Vector3 u = eigen.vectors.col(0);
  return outer_product(2.0 * c * u, u);
}

/// What Theorem 1 does not know: that X_ij = R_i^T R_j is a rotation for every edge.
///
/// For a symmetric P, over X in SO(3) turned into the global frame, -tr(P X) is least at X = I if
///
///     Q = tr(P) I - P >= 0,
///
/// as tr(P) - tr(P exp[r]) = (1 - cos |r|) u^T Q u. Such a term costs a lower bound nothing and has
/// no gradient there. So of the block of every edge, G = R_i N R_j^T, some P with Q >= 0 may be
/// taken away before the certificate matrix is made:
///
///     S_ij = - sum (G - P),     S_ii = sum sym(G - P),
///
/// S >= 0 proves the optimum, and for any R, stationary or not, f(R) - f* <= tr(S Y) at the worst
/// feasible Y (Y >= 0, Y_ii = I), as ever. With T = tr(G) I - sym(G) and W = sym(G) - P,
///
///     G - P = W + [p],     tr(W) I - W = T - Q,     W = tr(T - Q) / 2 I - (T - Q),
///
/// so Q is the part of the precision that is given up for a better W: the edge adds b b^T (x) W to
/// S and its turn [p].
///
/// In closed form: with sym(G) = U diag(m1 >= m2 >= m3) U^T, Q = 2 c u u^T along the third vector
/// makes that diag(m1 - c, m2 - c, m3 + c). m3 is negative where one precision exceeds the sum of
/// the other two; where it is below a quarter of m2, c lifts it to a quarter of what m2 becomes, so
/// that W > 0 wherever the edge is well posed; elsewhere Q = 0. (To lift it just to zero would
/// leave W singular, and fewer graphs are proved so. The multipliers are those of the relaxation
/// with X_ij in the convex hull of SO(3): Olsson, Lochman, Malmport and Zach 2025, arXiv
/// 2503.07353.)
class EdgeSplits {
 public:
  /// The closed form, at some rotations.
  /// @param residuals must outlive this object
  explicit EdgeSplits(const AnisotropicResiduals& residuals) : residuals_(&residuals) {
    Q_.reserve(residuals().size());
    for (const EdgeForce& edge : residuals()) Q_.push_back(closed_form_split(edge.T));  // of sym(G)
  }

  const AnisotropicResiduals& residuals() const { return *residuals_; }

  /// W of an edge, less what rounding can have added to T: so what is given up is admissible
  /// outright. T carries an error of 700 u tr(H) at most (32 u of the residual quaternion, 9 u of a
  /// rotation's entries, products), and Q's own negative part is of rounding, too.
  Matrix3 W(std::size_t k) const {
    Matrix3 W = half_trace_less((*residuals_)()[k].T - Q_[k]);
    add_to_diagonal(W, -rounding(k));
    return W;
  }
  double rounding(std::size_t k) const {
    constexpr double relative = 1000.0 * 1.2e-16;
    return relative * (residuals_->graph().precisions()[k].trace() + Q_[k].trace());
  }

  /// Q <- the positive semidefinite matrix nearest to Q + dQ.
  void change(std::size_t k, const Matrix3& dQ) {
    const SymmetricEigen eigen = symmetric_eigen(Q_[k] + dQ);
    Q_[k].setZero();
    for (int c = 0; c < 3; ++c) {
      const Vector3 u = eigen.vectors.col(c);
      Q_[k] += outer_product(std::max(0.0, eigen.values(c)) * u, u);
    }
  }

 private:
  const AnisotropicResiduals* residuals_;
  std::vector<Matrix3> Q_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

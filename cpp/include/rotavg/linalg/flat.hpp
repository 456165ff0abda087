#pragma once

#include <Eigen/Core>

namespace rotavg {

// What does not depend on the shape of dense matrices, over their entries in memory: one type of
// expression for all shapes, which spares a compiler the others.

using FlatView = Eigen::Map<const Eigen::VectorXd>;

/// The sum of a_k b_k over all entries of two matrices of one shape.
template <typename Matrix>
double flat_dot(const Matrix& A, const Matrix& B) {
  return FlatView(A.data(), A.size()).dot(FlatView(B.data(), B.size()));
}

/// A <- s A + t B.
template <typename Matrix>
void flat_combine(double s, Matrix& A, double t, const Matrix& B) {
  Eigen::Map<Eigen::VectorXd> a(A.data(), A.size());
  a = s * a + t * FlatView(B.data(), B.size());
}

}  // namespace rotavg

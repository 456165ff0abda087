#pragma once

#include <algorithm>

#include <Eigen/Core>

#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

// What does not depend on the shape of dense matrices, over their entries in memory: one type of
// expression for all shapes, which spares a compiler the others. With the same bits for any number
// of threads.

using FlatView = Eigen::Map<const Eigen::VectorXd>;

/// The sum of a_k b_k over all entries of two matrices of one shape.
template <typename Matrix>
double flat_dot(const Matrix& A, const Matrix& B, int num_threads = 1) {
  constexpr Eigen::Index piece = 128;
  const Eigen::Index size = A.size();
  return block_sum<double>(
      static_cast<Index>((size + piece - 1) / piece),
      threads_for(num_threads, 2.0 * static_cast<double>(size)), [&](Index k) {
        const Eigen::Index begin = k * piece, length = std::min(piece, size - begin);
        return FlatView(A.data() + begin, length).dot(FlatView(B.data() + begin, length));
      });
}

/// A <- s A + t B.
template <typename Matrix>
void flat_combine(double s, Matrix& A, double t, const Matrix& B, int num_threads = 1) {
  constexpr Eigen::Index piece = 2048;
  const Eigen::Index size = A.size();
  parallel_for(static_cast<Index>((size + piece - 1) / piece),
               threads_for(num_threads, 2.0 * static_cast<double>(size)), [&](Index k) {
                 const Eigen::Index begin = k * piece, length = std::min(piece, size - begin);
                 Eigen::Map<Eigen::VectorXd> a(A.data() + begin, length);
                 a = s * a + t * FlatView(B.data() + begin, length);
               });
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A dense front of the multifrontal method, of B x B blocks: [A11; A21] in the panel, A22 in the
/// rest.
template <int B>
struct Front {
  double* panel;
  Index pivots, below;  // scalar rows
  double* rest;

  /// Column c, such that its entry in row r stands at [r].
  double* column(Index c) const {
    const std::size_t height = pivots + below;
    return c < pivots ? panel + c * height
                      : rest + static_cast<std::size_t>(c - pivots) * below - pivots;
  }
  /// A block of the panel.
  using BlockView = Eigen::Map<Eigen::Matrix<double, B, B>, 0, Eigen::OuterStride<>>;
  BlockView block(Index row, Index column) const {
    return BlockView(this->column(B * column) + B * row, Eigen::OuterStride<>(pivots + below));
  }
  void set_zero(int num_threads) const {
    parallel_for((pivots + below) / B, num_threads, [&](Index k) {
      for (Index c = B * k; c < B * (k + 1); ++c) {
        std::fill(column(c) + B * k, column(c) + pivots + below, 0.0);
      }
    });
  }
  /// Adds what a child left over: the lower triangle of a matrix whose rows stand at these
  /// places.
  void add(const std::vector<Index>& places, const double* child, int num_threads) const {
    const std::size_t height = B * places.size();
    parallel_for(static_cast<Index>(places.size()), num_threads, [&](Index c) {
      for (int k = 0; k < B; ++k) {
        const double* const from = child + (B * c + k) * height;
        double* const target = column(B * places[c] + k);
        for (std::size_t r = c; r < places.size(); ++r) {
          double* const out = target + B * places[r];
          for (int i = 0; i < B; ++i) out[i] += from[B * r + i];
        }
      }
    });
  }
};

}  // namespace rotavg

#pragma GCC diagnostic pop

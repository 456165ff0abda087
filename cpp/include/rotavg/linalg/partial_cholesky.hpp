#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include <rotavg/parallel/interruption.hpp>
#include <rotavg/parallel/prefetch.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

enum class CholeskyOutcome { positive_definite, not_positive_definite, stopped };

/// The first columns of a dense Cholesky factorisation, and what they leave of the rest:
///
///     [ A11      ]   [ L11    ] [ L11^T  L21^T ]   [ 0             ]
///     [ A21  A22 ] = [ L21  I ] [          I   ] + [ 0  A22 - L21 L21^T ].
///
/// Column-major; only lower triangles are read, and what stands above the diagonals loses its
/// meaning. The work is done on tiles that stay in registers, 3 columns wide, from copies of the
/// finished columns packed in the order in which the tiles read them. Within a block of columns a
/// tile subtracts what the columns to its left contribute and is solved with the 3 x 3 triangle
/// above it ("left-looking"); a finished block is then subtracted from all that is to its right.
/// Of both, strips of rows are independent, and threads share them.
///
/// An object keeps its buffers between calls.
class PartialCholesky {
 public:
  /// @param panel (pivots + below) x pivots, leading dimension pivots + below: [A11; A21] in, [L11;
  ///        L21] out
  /// @param rest below x below, leading dimension below: A22 in, A22 - L21 L21^T out
  /// @param interruption asked now and then whether to go on
  /// @returns positive_definite if all pivots were positive and finite; what is not finite below
  ///          them leaves its diagonal entry in the rest NaN or -infinity. Otherwise the result is
  ///          unfinished.
  CholeskyOutcome operator()(double* panel, Index pivots, Index below, double* rest,
                             Interruption& interruption, int num_threads = 1) {
    num_threads_ = num_threads;
    const Index stride = pivots + below;
    for (Index begin = 0; begin < pivots; begin += block) {
      const Index width = std::min(block, pivots - begin);
      top_.assign(pivots - begin, width);
      bottom_.assign(below, width);
      double* const top = panel + at(begin, begin, stride);
      double* const bottom = panel + at(pivots, begin, stride);
      if (!factorize_diagonal_block(top, stride, width, interruption)) {
        return interruption.is_stopped() ? CholeskyOutcome::stopped
                                         : CholeskyOutcome::not_positive_definite;
      }
      const Range right{top_, width, pivots - begin - width};  // columns of the panel that remain
      const Range rows_below{bottom_, 0, below};
      solve_rows(top + width, stride, right, width, interruption);
      solve_rows(bottom, stride, rows_below, width, interruption);
      subtract_products(rest, below, rows_below, rows_below, interruption);
      if (right.size > 0) {
        subtract_products(top + at(width, width, stride), stride, right, right, interruption);
        subtract_products(bottom + at(0, width, stride), stride, rows_below, right, interruption);
      }
      if (interruption.is_stopped()) return CholeskyOutcome::stopped;
    }
    return CholeskyOutcome::positive_definite;
  }

 private:
  // Numbers in a register. (Wider ones, where there are any, leave more of small tiles unused.)
  static constexpr Index lanes = EIGEN_MAX_STATIC_ALIGN_BYTES >= 32 ? 4 : 2;
  static constexpr Index packs = 3;
  static constexpr Index tile_rows = packs * lanes;
  static constexpr Index tile_columns = 3;
  static constexpr Index block = 96;  // columns: a strip of rows, tile_rows x block, stays near
  static_assert(block % tile_rows == 0 && tile_rows % tile_columns == 0);
  using Pack = Eigen::Array<double, lanes, 1>;
  using UnalignedPack = Eigen::Map<Pack>;
  using AlignedPack = Eigen::Map<const Pack, Eigen::AlignedMax>;

  static Index round_up(Index size, Index multiple) {
    return (size + multiple - 1) / multiple * multiple;
  }
  static std::size_t at(Index row, Index column, Index rows) {
    return static_cast<std::size_t>(column) * rows + row;
  }

  /// The lower triangle of a diagonal block of L.
  struct Triangle {
    double L[tile_columns][tile_columns] = {};
  };

  /// Finished columns of L in strips of tile_rows rows, each strip column by column; rows beyond
  /// the last are zero.
  class PackedRows {
   public:
    void assign(Index rows, Index columns) {
      rows_ = rows;
      depth_ = round_up(columns, tile_columns);  // padded with zeros
      num_strips_ = (rows + tile_rows - 1) / tile_rows;
      stride_ = static_cast<std::size_t>(depth_) * tile_rows;
      const std::size_t size = stride_ * num_strips_;
      if (values_.size() < size) values_.resize(size);
    }
    Index rows() const { return rows_; }
    Index depth() const { return depth_; }
    Index num_strips() const { return num_strips_; }
    double* strip(Index s) { return values_.data() + s * stride_; }
    /// Where row r begins: its entries stand tile_rows apart.
    double* row(Index r) { return strip(r / tile_rows) + r % tile_rows; }

   private:
    std::vector<double, Eigen::aligned_allocator<double>> values_;
    Index rows_ = 0, depth_ = 0, num_strips_ = 0;
    std::size_t stride_ = 0;
  };

  /// tile_rows x tile_columns of a product of packed rows, in registers.
  struct Tile {
    Pack sum[tile_columns][packs];

    /// sum_k a(., k) b(., k)^T for k = 0 … depth-1.
    EIGEN_STRONG_INLINE Tile(const double* a, const double* b, Index depth) {
      Pack s00 = Pack::Zero(), s01 = s00, s02 = s00, s10 = s00, s11 = s00, s12 = s00, s20 = s00,
           s21 = s00, s22 = s00;
      for (Index k = 0; k < depth; ++k, a += tile_rows, b += tile_rows) {
        const Pack a0 = AlignedPack(a), a1 = AlignedPack(a + lanes),
                   a2 = AlignedPack(a + 2 * lanes);
        const double b0 = b[0], b1 = b[1], b2 = b[2];
        s00 += a0 * b0;
        s01 += a1 * b0;
        s02 += a2 * b0;
        s10 += a0 * b1;
        s11 += a1 * b1;
        s12 += a2 * b1;
        s20 += a0 * b2;
        s21 += a1 * b2;
        s22 += a2 * b2;
      }
      sum[0][0] = s00, sum[0][1] = s01, sum[0][2] = s02;
      sum[1][0] = s10, sum[1][1] = s11, sum[1][2] = s12;
      sum[2][0] = s20, sum[2][1] = s21, sum[2][2] = s22;
    }

    /// Subtracts the first rows and columns of the tile, whose first entry stands at C.
    EIGEN_STRONG_INLINE void subtract_from(double* C, Index stride, Index rows,
                                           Index columns) const {
      for (Index c = 0; c < columns; ++c, C += stride) {
        if (rows == tile_rows) {
          for (Index p = 0; p < packs; ++p) UnalignedPack(C + p * lanes) -= sum[c][p];
        } else {
          for (Index r = 0; r < rows; ++r) C[r] -= sum[c][r / lanes](r % lanes);
        }
      }
    }
  };

  /// Some of the packed rows.
  struct Range {
    PackedRows& packed;
    Index begin;  // a multiple of tile_rows
    Index size;
  };

  /// Factorises the rows of the diagonal block, and packs them.
  bool factorize_diagonal_block(double* top, Index stride, Index width,
                                Interruption& interruption) {
    for (Index c = 0; c < width; c += tile_columns) {
      const Index columns = std::min(tile_columns, width - c);
      if (!interruption.goes_on(static_cast<double>(width - c) * columns * (c + columns))) {
        return false;
      }
      Triangle& triangle = triangles_[c / tile_columns];
      if (!factorize_diagonal(top + at(c, c, stride), stride, columns, c, triangle)) return false;
      // The strips of rows below, beginning with the one that holds the diagonal block.
      for (Index first = c / tile_rows * tile_rows; first < width; first += tile_rows) {
        const Index done = std::max<Index>(0, c + columns - first);
        solve_strip(top + at(first, c, stride), stride, std::min(tile_rows, width - first), done,
                    columns, c, triangle, top_.row(first), top_.row(c));
      }
    }
    return true;
  }

  /// The columns of the block in further rows, the first of which stands at A; packs them.
  void solve_rows(double* A, Index stride, Range rows, Index width, Interruption& interruption) {
    const double of_strip = 0.5 * tile_rows * width * width;
    for_each_strip(rows.size, 0.5 * rows.size * width * width, 1, [&](Index first) {
      if (!interruption.goes_on(of_strip)) return;
      for (Index c = 0; c < width; c += tile_columns) {
        solve_strip(A + at(first, c, stride), stride, std::min(tile_rows, rows.size - first), 0,
                    std::min(tile_columns, width - c), c, triangles_[c / tile_columns],
                    rows.packed.row(rows.begin + first), top_.row(c));
      }
    });
  }

  /// C -= A B^T, C of size A.size x B.size; only its lower triangle where A and B are the same. A
  /// few strips of A at a time, so that B, which the nearer caches do not hold, is not read anew
  /// for each; and each tile of C is asked for before its product.
  void subtract_products(double* C, Index stride, Range A, Range B, Interruption& interruption) {
    const bool lower = &A.packed == &B.packed;
    const Index depth = A.packed.depth();
    const double of_column = static_cast<double>(tile_rows) * depth;
    const Index strips = (A.size + tile_rows - 1) / tile_rows;
    const double all = of_column * strips * B.size;
    // As many as are some 300 KB, if they leave threads something to share.
    const int threads = threads_for(num_threads_, lower ? 0.5 * all : all);
    const Index together = threads == 1 ? 32 : std::clamp(strips / (6 * threads), 2, 32);
    for_each_strip(A.size, lower ? 0.5 * all : all, together, [&](Index first) {
      const Index end = std::min(A.size, first + together * tile_rows);
      const Index columns = lower ? end : B.size;
      if (!interruption.goes_on(static_cast<double>(columns) * (end - first) * depth)) return;
      for (Index left = 0; left < columns; left += tile_rows) {
        for (Index row = lower ? std::max(first, left) : first; row < end; row += tile_rows) {
          const Index rows = std::min(tile_rows, A.size - row);
          const double* const strip = A.packed.row(A.begin + row);
          const Index right = std::min({left + tile_rows, B.size, lower ? row + rows : B.size});
          for (Index c = left; c < right; c += tile_columns) {
            double* const target = C + at(row, c, stride);
            const Index width = std::min(tile_columns, B.size - c);
            prefetch_tile(target, stride, width);
            const Tile tile(strip, B.packed.row(B.begin + c), depth);
            tile.subtract_from(target, stride, rows, width);
          }
        }
      }
    });
  }

  static void prefetch_tile(const double* C, Index stride, Index columns) {
    constexpr std::size_t line = 64;
    for (Index c = 0; c < columns; ++c, C += stride) {
      const char* const first = reinterpret_cast<const char*>(C);
      for (std::size_t byte = 0; byte < tile_rows * sizeof(double); byte += line) {
        prefetch(first + byte);
      }
    }
  }

  /// Calls f for the first row of every so many strips, on as many threads as the work is
  /// worth; the last strips, which may be longest, first.
  template <typename Function>
  void for_each_strip(Index rows, double multiplications, Index together, Function&& f) {
    const Index step = together * tile_rows, steps = (rows + step - 1) / step;
    parallel_for(steps, threads_for(num_threads_, multiplications),
                 [&](Index k) { f((steps - 1 - k) * step); });
  }

  /// Subtracts from a diagonal block what the columns before c contribute, and factorises it.
  bool factorize_diagonal(double* A, Index stride, Index width, Index c, Triangle& triangle) {
    const double* const row = top_.row(c);
    for (Index j = 0; j < width; ++j) {
      for (Index i = j; i < width; ++i) {
        double sum = 0.0;
        for (Index k = 0; k < c; ++k) sum += row[at(i, k, tile_rows)] * row[at(j, k, tile_rows)];
        double a = A[at(i, j, stride)] - sum;
        for (Index k = 0; k < j; ++k) a -= triangle.L[i][k] * triangle.L[j][k];
        if (i == j) {
          if (!(a > 0.0) || !std::isfinite(a)) return false;
          triangle.L[j][j] = std::sqrt(a);
        } else {
          triangle.L[i][j] = a / triangle.L[j][j];
        }
        A[at(i, j, stride)] = triangle.L[i][j];
      }
    }
    return true;
  }

  /// Subtracts from rows of the current columns what the columns before c contribute, solves with
  /// the triangle above, and packs the result. The first `skipped` rows are done or lie above the
  /// diagonal; the packed copy holds the triangle there.
  void solve_strip(double* A, Index stride, Index rows, Index skipped, Index width, Index c,
                   const Triangle& triangle, double* packed, const double* pivot_rows) {
    Tile tile(packed, pivot_rows, c);
    double* const out = packed + at(0, c, tile_rows);
    const bool whole = rows == tile_rows && skipped == 0 && width == tile_columns;
    for (Index j = 0; j < tile_columns; ++j) {
      for (Index p = 0; p < packs; ++p) {
        Pack x = Pack::Zero();
        if (whole) {
          x = UnalignedPack(A + at(p * lanes, j, stride));
        } else if (j < width) {
          for (Index r = 0; r < lanes; ++r) {
            const Index row = p * lanes + r;
            if (row >= skipped && row < rows) x(r) = A[at(row, j, stride)];
          }
        }
        x -= tile.sum[j][p];
        for (Index k = 0; k < j; ++k) x -= tile.sum[k][p] * triangle.L[j][k];
        if (j < width) x /= triangle.L[j][j];
        tile.sum[j][p] = x;  // now of L
        if (whole) UnalignedPack(A + at(p * lanes, j, stride)) = x;
        Eigen::Map<Pack, Eigen::AlignedMax>(out + at(p * lanes, j, tile_rows)) = x;
      }
      if (whole) continue;
      for (Index r = 0; r < tile_rows; ++r) {
        double& copy = out[at(r, j, tile_rows)];
        if (r >= rows || j >= width) {
          copy = 0.0;
        } else if (r >= skipped) {
          A[at(r, j, stride)] = copy;
        } else {  // the triangle, and zeros above it
          const Index i = r - (skipped - width);
          copy = i >= j ? triangle.L[i][j] : 0.0;
        }
      }
    }
  }

  PackedRows top_, bottom_;
  Triangle triangles_[block / tile_columns];  // of the diagonal block
  int num_threads_ = 1;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

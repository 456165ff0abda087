#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include <Eigen/Core>

#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Several sums at once.
template <int N>
struct Sums {
  double value[N] = {};
  Sums& operator+=(const Sums& other) {
    for (int k = 0; k < N; ++k) value[k] += other.value[k];
    return *this;
  }
};

/// The columns that the operators of a random start (certify/random_start.hpp) work on: z = D^-1/2
/// y, C of them side by side, in the inner product z^T D z = |y|^2.
///
/// @tparam Operator derived from this, with num_nodes(), num_threads(), degree(a) (D at a node) and
///         project(z), onto the complement of the null vectors
template <typename Operator, int C>
class OperatorColumns {
 public:
  using Block = Eigen::Matrix<double, 3, C>;
  using Vectors = LargeVector<Block>;  ///< one for each node
  using Row = std::array<double, C>;

  /// Of every column of x and of y, x^T D y.
  Row products(const Vectors& x, const Vectors& y) const {
    const auto sums = block_sum<Sums<C>>(self().num_nodes(), node_threads(), [&](Index a) {
      Sums<C> products;
      const double degree = self().degree(a);
      for (int c = 0; c < C; ++c) {
        products.value[c] =
            degree * (x[a](0, c) * y[a](0, c) + x[a](1, c) * y[a](1, c) + x[a](2, c) * y[a](2, c));
      }
      return products;
    });
    Row row;
    for (int c = 0; c < C; ++c) row[static_cast<std::size_t>(c)] = sums.value[c];
    return row;
  }

  /// Columns that are uniform on the unit sphere of the complement.
  Vectors random(std::uint64_t seed) const {
    constexpr double two_pi = 6.283185307179586;
    constexpr Index nodes_of_block = 1024;   // that share a generator
    constexpr double work_of_block = 300.0;  // of a node, for each column
    const Index n = self().num_nodes();
    Vectors z(static_cast<std::size_t>(n));
    const int num_threads = threads_for(self().num_threads(), work_of_block * C * n);
    parallel_for((n + nodes_of_block - 1) / nodes_of_block, num_threads, [&](Index b) {
      std::seed_seq sequence{seed, seed >> 32, static_cast<std::uint64_t>(b)};  // 32 bits of each
      std::mt19937_64 generator(sequence);
      const Index end = std::min(n, (b + 1) * nodes_of_block);
      for (Index a = b * nodes_of_block; a < end; ++a) {  // y is normal (Box and Muller)
        const double root = std::sqrt(self().degree(a));
        for (Eigen::Index k = 0; k < z[a].size(); ++k) {
          const double radius = std::sqrt(-2.0 * std::log1p(-random_unit(generator)));
          z[a](k) = radius * std::cos(two_pi * random_unit(generator)) / root;
        }
      }
    });
    self().project(z);
    const Row squares = products(z, z);
    for (Block& block : z) {
      for (Eigen::Index k = 0; k < block.size(); ++k) block(k) /= std::sqrt(squares[k / 3]);
    }
    return z;
  }

 protected:
  /// Of sums over the nodes, in blocks (parallel/reduce.hpp), which project() and products() are
  /// made of.
  double rounding_of_sums() const {
    constexpr double block = 64.0;
    return (block + self().num_nodes() / block) * unit_roundoff;
  }
  /// For loops over the nodes.
  int node_threads() const {
    return threads_for_nodes(self().num_threads(), C * self().num_nodes());
  }
  /// y += A x. (Eigen's product is slower here.)
  static void add_product(const Matrix3& A, const Block& x, Block& y) {
    for (int c = 0; c < C; ++c) {
      const double x_0 = x(0, c), x_1 = x(1, c), x_2 = x(2, c);
      y(0, c) += A(0, 0) * x_0 + A(0, 1) * x_1 + A(0, 2) * x_2;
      y(1, c) += A(1, 0) * x_0 + A(1, 1) * x_1 + A(1, 2) * x_2;
      y(2, c) += A(2, 0) * x_0 + A(2, 1) * x_1 + A(2, 2) * x_2;
    }
  }

 private:
  const Operator& self() const { return static_cast<const Operator&>(*this); }
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/certify/bound.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// M = D^-1/2 S D^-1/2 of one component with full covariances, on the complement of D^1/2 N, N =
/// [I … I]^T, for the iterations that factorise nothing (certify/random_start.hpp); as
/// LocalOperator, but in the global frame. With D the scale of the nodes its spectrum is below 2:
/// an edge adds d^T W d - 2 x_i . p x x_j <= (2 |W| + |p|) (|x_i|^2 + |x_j|^2).
///
/// @tparam C columns
template <int C>
class GlobalOperator {
 public:
  using Block = Eigen::Matrix<double, 3, C>;
  using Vectors = std::vector<Block, Eigen::aligned_allocator<Block>>;  ///< one for each node
  using Row = std::array<double, C>;

  /// @param S must outlive this object
  explicit GlobalOperator(const AnisotropicCertificateMatrix& S) : S_(&S) {
    for (Index a = 0; a < num_nodes(); ++a) total_ += degree(a);
  }
  /// The same with other columns.
  template <int K>
  explicit GlobalOperator(const GlobalOperator<K>& other) : GlobalOperator(other.matrix()) {}

  const AnisotropicCertificateMatrix& matrix() const { return *S_; }
  Index num_nodes() const { return S_->num_nodes(); }
  int num_threads() const { return S_->num_threads(); }
  /// Of the complement.
  Eigen::Index dimension() const { return S_->size() - 3; }
  double degree(Index a) const { return S_->scale(a); }
  Vector3 in_global_frame(Index, const Vector3& z) const { return z; }

  /// Bounds the rounding of one product, |computed - M y| <= rounding() |y|.
  double rounding() const {
    double worst = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) {
      const double sums = 8.0 * (S_->num_edges_at(a) + 16.0) * unit_roundoff;
      worst = std::max(worst, S_->block_rounding(a) / degree(a) + sums);
    }
    return worst;
  }

  /// result <- scale D^-1 S z + shift z + old result * factor
  void apply(const Vectors& z, double scale, double shift, double factor, Vectors& result) const {
    parallel_for(num_nodes(), num_threads(), [&](Index a) {
      Block sum = Block::Zero();
      S_->add_row(a, [&](const Matrix3& A, Index b) { sum.noalias() += A * z[b]; });
      const double s = scale / degree(a);
      for (int k = 0; k < 3 * C; ++k) {
        result[a](k) = s * sum(k) + shift * z[a](k) + factor * result[a](k);
      }
    });
  }

  /// Onto the complement: N^T D z = 0.
  void project(Vectors& z) const {
    Sum<3 * C> mean = block_sum<Sum<3 * C>>(num_nodes(), num_threads(), [&](Index a) {
      Sum<3 * C> along;
      for (int k = 0; k < 3 * C; ++k) along.value[k] = degree(a) * z[a](k);
      return along;
    });
    parallel_for(num_nodes(), num_threads(), [&](Index a) {
      for (int k = 0; k < 3 * C; ++k) z[a](k) -= mean.value[k] / total_;
    });
  }

  /// Of every column of x and of y, x^T D y.
  Row products(const Vectors& x, const Vectors& y) const {
    const auto sums = block_sum<Sum<C>>(num_nodes(), num_threads(), [&](Index a) {
      Sum<C> products;
      for (int c = 0; c < C; ++c) products.value[c] = degree(a) * x[a].col(c).dot(y[a].col(c));
      return products;
    });
    Row row;
    for (int c = 0; c < C; ++c) row[static_cast<std::size_t>(c)] = sums.value[c];
    return row;
  }

  /// Columns that are uniform on the unit sphere of the complement.
  Vectors random(std::uint64_t seed) const {
    constexpr double two_pi = 6.283185307179586;
    std::mt19937_64 generator(seed);
    Vectors z(static_cast<std::size_t>(num_nodes()));
    for (Index a = 0; a < num_nodes(); ++a) {  // y is normal (Box and Muller)
      for (Eigen::Index k = 0; k < z[a].size(); ++k) {
        const double radius = std::sqrt(-2.0 * std::log1p(-random_unit(generator)));
        z[a](k) = radius * std::cos(two_pi * random_unit(generator)) / std::sqrt(degree(a));
      }
    }
    project(z);
    const Row squares = products(z, z);
    for (Block& block : z) {
      for (int c = 0; c < C; ++c) block.col(c) /= std::sqrt(squares[c]);
    }
    return z;
  }

 private:
  /// Several sums at once.
  template <int N>
  struct Sum {
    double value[N] = {};
    Sum& operator+=(const Sum& other) {
      for (int k = 0; k < N; ++k) value[k] += other.value[k];
      return *this;
    }
  };

  const AnisotropicCertificateMatrix* S_;
  double total_ = 0.0;
};

/// The bound that a random start gives, |D^-1/2 K|_F^2 / cut with K = S N the leftover and its
/// rounding: see bound_by_random_start() of a CertificateMatrix.
inline ComponentBound bound_by_random_start(const AnisotropicCertificateMatrix& S, double cut) {
  const Eigen::MatrixXd K = S.leftover();
  double square = 0.0, rounding = 0.0, total = 0.0, largest = 0.0;
  for (Index a = 0; a < S.num_nodes(); ++a) {
    square += K.middleRows<3>(3 * a).squaredNorm() / S.scale(a);
    rounding += std::pow(S.leftover_rounding(a), 2) / S.scale(a);
    total += S.scale(a);
    largest = std::max(largest, S.scale(a));
  }
  const double root = std::sqrt(square) + std::sqrt(rounding);
  ComponentBound bound;
  bound.method = CertificateMethod::random_start;
  bound.is_definite = true;
  bound.gap = (1.0 + 1e-9) * root * root / cut;
  bound.rounding = rounding / cut;
  bound.lambda_min = -bound.gap * largest / total;  // not below: |c|^2 <= max d / sum d |x|^2
  return bound;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

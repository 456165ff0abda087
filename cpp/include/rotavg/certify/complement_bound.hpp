#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <utility>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What it says of the gap that S is at least `cut` D on the complement of its null vectors N.
///
/// Split any x as N c + z with N^T D z = 0. With the leftover K = S N, any Z on the complement and
/// rho = K - S Z,
///
///     c^T K^T z = c^T Z^T S z + c^T rho^T z <= (|S^1/2 Z c| + |D^-1/2 rho c| / cut^1/2) |S^1/2 z|,
///
/// and as N^T S N = 0, x^T S x = 2 c^T K^T z + z^T S z is at least minus the square of what stands
/// in the brackets. The three rows of a point of (6) add up to that of all columns (Minkowski), as
/// their means c, weighted by D, satisfy sum c c^T <= I (certify/connectivity.hpp):
///
///     f(R) - f* <= (tr(Z^T S Z)^1/2 + |D^-1/2 rho|_F / cut^1/2)^2.
///
/// Z = 0 takes no product, but charges all of K to the least eigenvalue. Where that exceeds the
/// resolution, Z comes from conjugate gradients for S Z = K. What rounding has done to K is added
/// in the brackets, too.
///
/// @tparam Operator M = D^-1/2 S D^-1/2 on three columns (LocalOperator<3> or one like it)
template <typename Operator>
class ComplementBound {
 public:
  /// @param M, K (3n x 3, in the global frame), keep_going must outlive this object
  ComplementBound(const Operator& M, const Eigen::MatrixXd& K, double cut,
                  const std::function<bool()>& keep_going)
      : M_(M), K_(K), cut_(cut), keep_going_(keep_going) {}

  /// @param rounding what the rounding of K adds in the brackets
  /// @param resolution how small a gap has to be told from zero
  ComponentBound operator()(double rounding, double resolution) {
    Vectors rho = leftover();
    double root = std::sqrt(sum(M_.products(rho, rho)) / cut_);
    if (square(root + rounding) > resolution) {
      root = std::min(root, by_conjugate_gradients(std::move(rho), rounding, resolution));
    }
    double largest = 0.0, total = 0.0;
    for (Index a = 0; a < M_.num_nodes(); ++a) {
      largest = std::max(largest, M_.degree(a));
      total += M_.degree(a);
    }
    constexpr double margin = 1.0 + 1e-9;  // for the rounding of these sums
    ComponentBound bound;
    bound.method = CertificateMethod::random_start;
    bound.is_definite = true;
    bound.gap = margin * square(root + rounding);
    bound.rounding = square(rounding);
    bound.lambda_min = -bound.gap * largest / total;  // not below: |c|^2 <= max d / sum d |x|^2
    return bound;
  }

 private:
  using Block = typename Operator::Block;
  using Vectors = typename Operator::Vectors;
  using Row = typename Operator::Row;

  static double square(double x) { return x * x; }
  static double sum(const Row& row) { return row[0] + row[1] + row[2]; }

  /// D^-1 K on the complement, in the frames of the nodes.
  Vectors leftover() const {
    Vectors rho(static_cast<std::size_t>(M_.num_nodes()));
    for (Index a = 0; a < M_.num_nodes(); ++a) {
      const Matrix3 block = K_.template block<3, 3>(3 * static_cast<Eigen::Index>(a), 0);
      rho[a] = M_.in_own_frame(a, block) / M_.degree(a);
    }
    M_.project(rho);
    return rho;
  }

  /// What stands in the brackets, with Z by conjugate gradients that D preconditions. They end
  /// where what is left of K adds little, or the gap is small enough. M has its spectrum in [cut,
  /// 2], so that the error falls by e^-sqrt(2 cut) a step, and 4 / sqrt(cut) leave less than one
  /// per cent.
  double by_conjugate_gradients(Vectors rho, double rounding, double resolution) const {
    constexpr double little = 0.1, small_enough = 0.5, steps_of_root = 4.0, most_steps = 1000.0;
    const int max_steps = static_cast<int>(std::min(steps_of_root / std::sqrt(cut_), most_steps));
    Vectors Z(rho.size(), Block::Zero()), P(rho), SP(rho.size(), Block::Zero());
    Row squares = M_.products(rho, rho);
    double energy = 0.0;  // tr(Z^T S Z)
    for (int k = 0; k < max_steps; ++k) {
      const double left = std::sqrt(sum(squares) / cut_), root = std::sqrt(energy);
      if (left <= little * root) break;
      if (square(root + left + rounding) <= small_enough * resolution) break;
      if (keep_going_ && !keep_going_()) break;
      M_.apply(P, 1.0, 0.0, 0.0, SP);
      M_.project(SP);
      const Row curvature = M_.products(P, SP);
      Row step;
      for (std::size_t c = 0; c < 3; ++c) {
        step[c] = curvature[c] > 0.0 ? squares[c] / curvature[c] : 0.0;
        energy += step[c] * squares[c];
      }
      add_columns(step, P, Z);
      for (double& entry : step) entry = -entry;
      add_columns(step, SP, rho);
      const Row next = M_.products(rho, rho);
      Row along;
      for (std::size_t c = 0; c < 3; ++c) {
        along[c] = squares[c] > 0.0 ? next[c] / squares[c] : 0.0;
      }
      squares = next;
      SP = rho;
      add_columns(along, P, SP);
      std::swap(P, SP);
    }
    rho = P = Vectors();  // their memory is needed
    return in_brackets(std::move(Z), std::move(SP));
  }

  /// What stands in the brackets for the part of Z on the complement; the rounding of S Z is added.
  double in_brackets(Vectors Z, Vectors SZ) const {
    M_.project(Z);
    M_.apply(Z, 1.0, 0.0, 0.0, SZ);
    const double size = std::sqrt(sum(M_.products(Z, Z))), error = M_.rounding() * size;
    const double energy = std::max(sum(M_.products(Z, SZ)), 0.0) + error * size;
    Vectors rho = leftover();
    add_columns({-1.0, -1.0, -1.0}, SZ, rho);
    M_.project(rho);
    const double left = std::sqrt(sum(M_.products(rho, rho))) + error;
    return std::sqrt(energy) + left / std::sqrt(cut_);
  }

  /// y += x diag(factor)
  void add_columns(const Row& factor, const Vectors& x, Vectors& y) const {
    parallel_for(M_.num_nodes(), threads_for_nodes(M_.num_threads(), 3 * M_.num_nodes()),
                 [&](Index a) {
                   for (Eigen::Index k = 0; k < 9; ++k) {
                     y[a](k) += factor[static_cast<std::size_t>(k / 3)] * x[a](k);
                   }
                 });
  }

  const Operator& M_;
  const Eigen::MatrixXd& K_;
  double cut_;
  const std::function<bool()>& keep_going_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

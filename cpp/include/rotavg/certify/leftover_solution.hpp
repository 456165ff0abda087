#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/linalg/block_cholesky.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Z with A Z close to K, A = S_r - kappa L_r (x) I >= diag(mu), by conjugate gradients that the
/// scalar Laplacian preconditions: S = L (x) I_3 where all residuals vanish.
///
/// For any Z, with the residual rho = K - A Z, tr(K^T A^-1 K) <= tr(Z^T A Z) + 2 tr(Z^T rho) + sum
/// |rho_a|^2 / mu_a. They end where the last term adds little, or all is small enough, which after
/// a last step of Newton's method it mostly is at Z = 0. (The last term charges all of rho to mu,
/// so that more steps pay than where the least eigenvalue is known, complement_bound.hpp.)
class LeftoverSolution {
 public:
  /// @param S, elimination (without the root), mu (of its rows) must outlive this object
  LeftoverSolution(const CertificateMatrix& S, Elimination& elimination, double kappa,
                   const std::vector<double>& mu)
      : S_(S), elimination_(elimination), kappa_(kappa), mu_(mu) {}

  /// @param K (3n, 3), whose first three rows do not count
  /// @param resolution how small a gap has to be told from zero
  /// @returns (3n, 3), zero in the first three rows
  Eigen::MatrixXd operator()(const Eigen::MatrixXd& K, double resolution,
                             const std::function<bool()>& keep_going) const {
    constexpr double little = 0.01, small_enough = 0.1;
    constexpr int max_steps = 200;
    Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(K.rows(), 3), rho = K;
    rho.topRows<3>().setZero();
    double energy = 0.0;  // tr(Z^T A Z)
    const auto is_enough = [&] {
      const double left = weighted_square(rho);
      return left <= little * energy || energy + left <= small_enough * resolution;
    };
    if (is_enough()) return Z;
    BlockCholesky<1> laplacian(elimination_.symbolic(), elimination_.num_threads());
    const auto outcome =
        laplacian.factorize(grounded_laplacian(S_.graph(), elimination_), 0.0, keep_going);
    if (outcome != CholeskyOutcome::positive_definite) return Z;
    Eigen::MatrixXd P = preconditioned(laplacian, rho);
    Row squares = products(rho, P);
    for (int k = 0; k < max_steps && (!keep_going || keep_going()); ++k) {
      Eigen::MatrixXd AP = S_.apply_less_laplacian(P, kappa_);
      AP.topRows<3>().setZero();
      const Row curvature = products(P, AP);
      for (int c = 0; c < 3; ++c) {
        if (!(curvature(c) > 0.0)) continue;  // it has converged
        const double step = squares(c) / curvature(c);
        energy += step * squares(c);
        for (Eigen::Index row = 0; row < Z.rows(); ++row) {
          Z(row, c) += step * P(row, c);
          rho(row, c) -= step * AP(row, c);
        }
      }
      if (is_enough()) break;
      const Eigen::MatrixXd next = preconditioned(laplacian, rho);
      const Row next_squares = products(rho, next);
      for (int c = 0; c < 3; ++c) {
        const double along = squares(c) > 0.0 ? next_squares(c) / squares(c) : 0.0;
        for (Eigen::Index row = 0; row < Z.rows(); ++row) {
          P(row, c) = next(row, c) + along * P(row, c);
        }
      }
      squares = next_squares;
    }
    return Z;
  }

 private:
  using Row = Eigen::Vector3d;

  /// sum |rho_a|^2 / mu_a
  double weighted_square(const Eigen::MatrixXd& rho) const {
    double sum = 0.0;
    for (Index a = 1; a < S_.num_nodes(); ++a) {
      double of_node = 0.0;
      for (int k = 0; k < 9; ++k) of_node += std::pow(rho(3 * a + k % 3, k / 3), 2);
      sum += of_node / mu_[a - 1];
    }
    return sum;
  }

  /// Column by column.
  static Row products(const Eigen::MatrixXd& x, const Eigen::MatrixXd& y) {
    Row result = Row::Zero();
    for (int c = 0; c < 3; ++c) {
      for (Eigen::Index row = 0; row < x.rows(); ++row) result(c) += x(row, c) * y(row, c);
    }
    return result;
  }

  /// (L_r^-1 (x) I) X
  static Eigen::MatrixXd preconditioned(BlockCholesky<1>& laplacian, const Eigen::MatrixXd& X) {
    Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(X.rows(), 3);
    for (int r = 0; r < 3; ++r) {
      laplacian.solve_entries(
          3, [&](Index row, int c) { return X(3 * (row + 1) + r, c); },
          [&](Index row, int c, double solved) { Y(3 * (row + 1) + r, c) = solved; });
    }
    return Y;
  }

  const CertificateMatrix& S_;
  Elimination& elimination_;
  double kappa_;
  const std::vector<double>& mu_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

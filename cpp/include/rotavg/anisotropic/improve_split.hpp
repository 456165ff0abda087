#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/anisotropic/split.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/lobpcg.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/tall.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Steps that lift the smallest eigenvalue of S by other splits of the edges.
///
/// lambda_min(S) is concave in the Q of the edges, Q >= 0. For x with x^T S x < 0 and d = x_i -
/// x_j, the edge adds d^T W d, whose gradient in Q is d d^T - |d|^2 / 2 I. That of the lowest few
/// eigenvectors, the lower the more, is followed as far as Polyak's rule for an optimum near zero
/// says (Polyak 1969), and every Q is projected. All is relative to the scale of the nodes.
class SplitImprovement {
 public:
  /// @param splits, elimination (of the component, without its root) must outlive this object
  SplitImprovement(EdgeSplits& splits, Elimination& elimination)
      : splits_(splits),
        elimination_(elimination),
        cholesky_(elimination.symbolic(), elimination.num_threads()) {}

  /// The smallest eigenvalue of S_r relative to the scale, about; NaN before it is known.
  double value() const { return value_; }
  /// What S is at its vector, x^T S x / |x|^2: lambda_min(S) is not larger.
  double lambda_min() const { return value_ / lowest_.col(0).squaredNorm(); }

  /// One step, after measure().
  /// @param S of the present splits
  /// @returns false where there is nothing to improve
  bool step(const AnisotropicCertificateMatrix& S) {
    constexpr double beyond = 1.5, target = 1e-4, spread = 0.3;
    if (!(value_ < target)) return false;
    const double width = spread * std::max(-value_, target);
    // The weights of the lowest eigenvectors.
    Eigen::VectorXd share(lowest_.cols());
    for (Eigen::Index c = 0; c < share.size(); ++c) {
      share(c) = std::exp((value_ - values_(c)) / width);
    }
    share /= share.sum();
    std::vector<Matrix3> gradient;
    gradient.reserve(S.edges().size());
    double squares = 0.0;
    for (const auto& e : S.edges()) {
      Matrix3 sum = Matrix3::Zero();
      for (Eigen::Index c = 0; c < share.size(); ++c) {
        const Vector3 d = lowest_.col(c).segment<3>(3 * e.i) - lowest_.col(c).segment<3>(3 * e.j);
        sum += outer_product(share(c) * d, d);
      }
      const double trace = sum.trace();
      add_to_diagonal(sum, -0.5 * trace);
      sum *= splits_.residuals().graph().precisions()[e.edge].trace();
      squares += sum.squaredNorm();
      gradient.push_back(sum);
    }
    if (!(squares > 0.0)) return false;
    const double step = beyond * (target - value_) / squares;
    for (std::size_t k = 0; k < gradient.size(); ++k) {
      const Index edge = S.edges()[k].edge;
      gradient[k] *= step * splits_.residuals().graph().precisions()[edge].trace();
      splits_.change(edge, gradient[k]);
    }
    return true;
  }

  /// Finds the lowest eigenvectors of S_r x = lambda diag(scale) x, by iterations with the inverse
  /// of S_r + shift diag(scale).
  /// @returns false where the work was stopped
  bool measure(const AnisotropicCertificateMatrix& S, const std::function<bool()>& keep_going) {
    constexpr double growth = 3.0, least = 1e-4, most = 4.0;
    constexpr int first_rounds = 6, next_rounds = 3;
    std::vector<double> shift(static_cast<std::size_t>(S.num_nodes()));
    double relative = std::isnan(value_) ? 0.01 : std::max(least, -1.2 * value_);
    for (;; relative *= growth) {
      if (relative > most) return false;
      for (Index a = 0; a < S.num_nodes(); ++a) shift[a] = relative * S.scale(a);
      const auto outcome = cholesky_.factorize(S.blocks(elimination_, shift), 0.0, keep_going);
      if (outcome == CholeskyOutcome::stopped) return false;
      if (outcome == CholeskyOutcome::positive_definite) break;
    }
    const int rounds = lowest_.size() == 0 ? first_rounds : next_rounds;
    if (lowest_.size() == 0) {
      lowest_ = random_start(S.size(), std::min<Eigen::Index>(4, S.size() - 3));
    }
    for (int k = 0; k < rounds; ++k) {
      scale_rows(S, lowest_);
      Eigen::MatrixXd X = Eigen::MatrixXd::Zero(lowest_.rows(), lowest_.cols());
      X.bottomRows(cholesky_.size()) = cholesky_.solve(lowest_.bottomRows(cholesky_.size()));
      lowest_ = orthonormal(S, X);
    }
    // Rayleigh and Ritz.
    const Eigen::MatrixXd A = inner_products(lowest_, S.apply(lowest_));
    const SmallEigen ritz = small_eigen(0.5 * (A + A.transpose()));
    lowest_ = combinations(lowest_, ritz.vectors);
    values_ = ritz.values;
    value_ = values_(0);
    return true;
  }

 private:
  static void scale_rows(const AnisotropicCertificateMatrix& S, Eigen::MatrixXd& X) {
    for (Index a = 0; a < S.num_nodes(); ++a) X.middleRows<3>(3 * a) *= S.scale(a);
  }
  /// A basis with X^T diag(scale) X = I.
  static Eigen::MatrixXd orthonormal(const AnisotropicCertificateMatrix& S,
                                     const Eigen::MatrixXd& X) {
    Eigen::MatrixXd scaled = X;
    scale_rows(S, scaled);
    const SmallEigen gram = small_eigen(inner_products(X, scaled));
    Eigen::MatrixXd basis = gram.vectors;
    for (Eigen::Index c = 0; c < basis.cols(); ++c) {
      const double floor = 1e-14 * gram.values(gram.values.size() - 1);
      basis.col(c) /= std::sqrt(std::max(gram.values(c), floor));
    }
    return combinations(X, basis);
  }

  EdgeSplits& splits_;
  Elimination& elimination_;
  BlockCholesky<3> cholesky_;
  Eigen::MatrixXd lowest_;
  Eigen::VectorXd values_;
  double value_ = std::numeric_limits<double>::quiet_NaN();
};

}  // namespace rotavg

#pragma GCC diagnostic pop

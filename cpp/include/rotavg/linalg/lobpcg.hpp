#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <random>
#include <utility>

#include <Eigen/Core>

#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/tall.hpp>
#include <rotavg/so3/random.hpp>

namespace rotavg {

/// A symmetric operator (or a positive definite preconditioner) on the columns of a matrix.
using LinearOperator = std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>;

struct LobpcgOptions {
  double tolerance = 1e-10;         ///< stop at |A x - theta x|_2 <= tolerance
  double relative_tolerance = 0.0;  ///< … or at |A x - theta x|_2 <= relative_tolerance |theta|
  /// Stop when theta has fallen by no more than this over two iterations. Only a preconditioner
  /// close to the inverse makes that safe.
  double value_tolerance = -std::numeric_limits<double>::infinity();
  int min_iterations = 0;  ///< a start may look converged by accident
  int max_iterations = 500;
  std::function<bool()> keep_going;  ///< asked every iteration; false stops
};

/// An approximate eigenpair. Some eigenvalue of the operator (on the complement of the constraints)
/// lies within `residual` of `value`; `value` is a Rayleigh quotient, so never below the smallest.
struct Eigenpair {
  double value = 0.0;
  Eigen::VectorXd vector;
  double residual = 0.0;
  int iterations = 0;
  bool converged = false;  ///< to a tolerance of the options, value_tolerance included
};

/// Entries uniform in [-1, 1): a start for an eigenvalue iteration, the same bits every time.
inline Eigen::MatrixXd random_start(Eigen::Index rows, Eigen::Index columns) {
  std::mt19937_64 generator(0x5eed);
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&](Eigen::Index, Eigen::Index) {
    return 2.0 * random_unit(generator) - 1.0;
  });
}

namespace detail {

/// Columns and what the operator makes of them, kept together so that it is applied only once to
/// every new direction.
struct WithImage {
  Eigen::MatrixXd V, AV;
};

/// An orthonormal basis of the columns of several blocks, in their order; columns that depend on
/// those before them, to working precision, are left out. Where little is left of a column, its
/// image would be a difference of large numbers: there A is applied anew.
inline WithImage orthonormal_basis(std::initializer_list<const WithImage*> blocks,
                                   const LinearOperator& A, Eigen::Index rows,
                                   Eigen::Index max_size) {
  constexpr double little = 0.1;
  WithImage basis{Eigen::MatrixXd(rows, max_size), Eigen::MatrixXd(rows, max_size)};
  Eigen::Index size = 0;
  for (const WithImage* block : blocks) {
    for (Eigen::Index c = 0; c < block->V.cols() && size < max_size; ++c) {
      auto v = basis.V.col(size);
      auto Av = basis.AV.col(size);
      const double norm = block->V.col(c).norm();
      if (!(norm > 0.0) || !std::isfinite(norm)) continue;
      v = block->V.col(c) / norm;
      Av = block->AV.col(c) / norm;
      for (int pass = 0; pass < 2; ++pass) {  // twice is enough
        for (Eigen::Index k = 0; k < size; ++k) {
          const double along = basis.V.col(k).dot(v);
          v -= along * basis.V.col(k);
          Av -= along * basis.AV.col(k);
        }
      }
      const double left = v.norm();
      if (left < 1e-8) continue;
      v /= left;
      Av /= left;
      if (left < little) Av = A(v);
      ++size;
    }
  }
  basis.V.conservativeResize(Eigen::NoChange, size);
  basis.AV.conservativeResize(Eigen::NoChange, size);
  return basis;
}

/// max |H - H^T|.
inline double asymmetry(const Eigen::MatrixXd& H) {
  double largest = 0.0;
  for (Eigen::Index a = 0; a < H.rows(); ++a) {
    for (Eigen::Index b = 0; b < a; ++b) largest = std::max(largest, std::abs(H(a, b) - H(b, a)));
  }
  return largest;
}

inline bool meets(const LobpcgOptions& options, const Eigenpair& pair) {
  return pair.residual <=
         std::max(options.tolerance, options.relative_tolerance * std::abs(pair.value));
}

}  // namespace detail

/// The smallest eigenvalue of a symmetric operator A by LOBPCG (Knyazev 2001): Rayleigh-Ritz on the
/// current block X, the preconditioned residuals W and the last directions P. A start that holds an
/// exact eigenvector may be taken for the answer at once.
///
/// @param A the operator
/// @param T a preconditioner close to A^-1 on the directions that matter; the identity if empty
/// @param start N x k, the first block; k columns are iterated together
/// @param constraints N x c with orthonormal columns (c may be 0): the search stays orthogonal to
/// them
inline Eigenpair smallest_eigenpair(const LinearOperator& A, const LinearOperator& T,
                                    const Eigen::MatrixXd& start,
                                    const Eigen::MatrixXd& constraints,
                                    const LobpcgOptions& options) {
  using Eigen::MatrixXd;
  const Eigen::Index rows = start.rows();
  const auto project = [&](MatrixXd M) -> MatrixXd {
    if (constraints.cols() > 0) {
      for (int pass = 0; pass < 2; ++pass) {
        M -= combinations(constraints, inner_products(constraints, M));
      }
    }
    return M;
  };

  constexpr double drift = 1e-10;
  const Eigen::Index max_size = std::min(rows - constraints.cols(), 3 * start.cols());
  const auto with_image = [&](MatrixXd V) {
    MatrixXd AV = A(V);
    return detail::WithImage{std::move(V), std::move(AV)};
  };
  const detail::WithImage nothing{MatrixXd(rows, 0), MatrixXd(rows, 0)};
  detail::WithImage X = with_image(project(start)), P = nothing, W = nothing;
  Eigenpair best;
  int idle = 0;  // iterations in which theta hardly fell
  for (int iteration = 0;; ++iteration) {
    // Rayleigh-Ritz on span [X W P]
    const detail::WithImage basis = detail::orthonormal_basis({&X, &W, &P}, A, rows, max_size);
    const auto& [V, AV] = basis;
    if (V.cols() == 0) return best;
    const MatrixXd H = inner_products(V, AV);
    const SmallEigen ritz = small_eigen(0.5 * (H + H.transpose()));
    const Eigen::Index k = std::min(start.cols(), V.cols());
    const MatrixXd C = ritz.vectors.leftCols(k);
    const Eigen::Index others = std::max<Eigen::Index>(V.cols() - X.V.cols(), 0);
    X = with_image(combinations(V, C));  // anew, so that no error piles up
    P = {combinations(V.rightCols(others), C.bottomRows(others)),
         combinations(AV.rightCols(others), C.bottomRows(others))};
    // Errors of its image grow from one P to the next, and show in H.
    if (detail::asymmetry(H) > drift * H.cwiseAbs().maxCoeff()) P = with_image(std::move(P.V));
    MatrixXd residual = X.AV;
    for (Eigen::Index c = 0; c < k; ++c) residual.col(c) -= ritz.values(c) * X.V.col(c);
    residual = project(std::move(residual));
    const double fall = best.value - ritz.values(0);
    idle = iteration > 0 && fall <= options.value_tolerance ? idle + 1 : 0;
    best.value = ritz.values(0);
    best.vector = X.V.col(0);
    best.residual = residual.col(0).norm();
    best.iterations = iteration;
    const bool exhausted = V.cols() >= rows - constraints.cols();
    const bool settled = idle >= 2 || exhausted;
    const bool enough = settled || iteration >= options.min_iterations;
    best.converged = enough && (settled || detail::meets(options, best));
    if (best.converged || iteration >= options.max_iterations) break;
    if (options.keep_going && !options.keep_going()) break;
    W = with_image(project(T ? T(residual) : residual));
  }
  // What is returned is evaluated at the returned vector.
  const MatrixXd x = best.vector;
  MatrixXd Ax = project(A(x));
  best.value = best.vector.dot(Ax.col(0));
  Ax -= best.value * x;
  best.residual = Ax.norm();
  best.converged = best.converged || detail::meets(options, best);
  return best;
}

}  // namespace rotavg

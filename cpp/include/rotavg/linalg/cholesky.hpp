#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <vector>

#include <cholmod.h>
#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <rotavg/types.hpp>

namespace rotavg {

/// Column-compressed, holding the lower triangle of a symmetric matrix.
using SparseSymmetric = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

/// Sparse Cholesky factorisation, P (A + shift I) P^T = L L^T, of one sparsity pattern with many
/// values, by SuiteSparse's CHOLMOD. Only its simplicial code is used (Core and Cholesky modules,
/// LGPL-2.1+), row by row, so that a long factorisation can be stopped.
class SparseCholesky {
 public:
  enum class Outcome { not_run, positive_definite, not_positive_definite, stopped };

  /// Analyses the pattern: a fill-reducing ordering (AMD) and the size of L.
  /// @param lower lower triangle of A, compressed; needed only during the call
  /// @throws std::bad_alloc, or std::length_error where L is too large for its indices
  explicit SparseCholesky(const SparseSymmetric& lower) {
    cholmod_start(&common_);
    common_.supernodal = CHOLMOD_SIMPLICIAL;
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_AMD;
    common_.postorder = true;
    common_.print = 0;
    cholmod_sparse view = view_of(lower);
    symbolic_ = cholmod_analyze(&view, &common_);
    if (symbolic_ == nullptr) {
      const int status = common_.status;
      cholmod_finish(&common_);
      throw_error(status);
    }
    flops_ = common_.fl;
  }
  ~SparseCholesky() {
    cholmod_free_factor(&factor_, &common_);
    cholmod_free_factor(&symbolic_, &common_);
    cholmod_finish(&common_);
  }
  SparseCholesky(const SparseCholesky&) = delete;
  SparseCholesky& operator=(const SparseCholesky&) = delete;

  Eigen::Index size() const { return static_cast<Eigen::Index>(symbolic_->n); }
  /// Floating-point operations that a factorisation takes.
  double flops() const { return flops_; }

  /// Factorises A + shift I. A must have the pattern that was analysed.
  /// @param keep_going asked every few milliseconds; false stops
  Outcome factorize(const SparseSymmetric& lower, double shift,
                    const std::function<bool()>& keep_going) {
    cholmod_free_factor(&factor_, &common_);
    factor_ = cholmod_copy_factor(symbolic_, &common_);
    check(factor_ != nullptr);
    check(cholmod_change_factor(CHOLMOD_REAL, /*to_ll=*/1, /*to_super=*/0, /*to_packed=*/0,
                                /*to_monotonic=*/1, factor_, &common_));
    // P A P^T, whose upper triangle rowfac reads.
    cholmod_sparse view = view_of(lower);
    const auto free_sparse = [this](cholmod_sparse* A) { cholmod_free_sparse(&A, &common_); };
    const std::unique_ptr<cholmod_sparse, decltype(free_sparse)> permuted(
        cholmod_ptranspose(&view, 1, static_cast<int*>(symbolic_->Perm), nullptr, 0, &common_),
        free_sparse);
    check(permuted != nullptr);
    double beta[2] = {shift, 0.0};
    const std::size_t n = symbolic_->n;
    // About 10 million operations, a few milliseconds, between two questions.
    const auto chunk = static_cast<std::size_t>(
        std::max(1.0, std::min(static_cast<double>(n), 1e7 * static_cast<double>(n) / flops_)));
    Outcome outcome = Outcome::positive_definite;
    for (std::size_t start = 0; start < n && outcome == Outcome::positive_definite;
         start += chunk) {
      if (keep_going && !keep_going()) return Outcome::stopped;
      const std::size_t end = std::min(n, start + chunk);
      cholmod_rowfac(permuted.get(), nullptr, beta, start, end, factor_, &common_);
      check(common_.status >= CHOLMOD_OK);
      if (common_.status == CHOLMOD_NOT_POSDEF || factor_->minor < n) {
        outcome = Outcome::not_positive_definite;
      }
    }
    if (outcome == Outcome::positive_definite && !has_positive_diagonal()) {
      outcome = Outcome::not_positive_definite;
    }
    return outcome;
  }

  /// X with (A + shift I) X = B, after a factorisation that was positive definite.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& B) {
    cholmod_dense view{};
    view.nrow = static_cast<std::size_t>(B.rows());
    view.ncol = static_cast<std::size_t>(B.cols());
    view.d = view.nrow;
    view.nzmax = view.nrow * view.ncol;
    view.x = const_cast<double*>(B.data());
    view.xtype = CHOLMOD_REAL;
    view.dtype = CHOLMOD_DOUBLE;
    cholmod_dense* X = cholmod_solve(CHOLMOD_A, factor_, &view, &common_);
    check(X != nullptr);
    const Eigen::MatrixXd result =
        Eigen::Map<const Eigen::MatrixXd>(static_cast<double*>(X->x), B.rows(), B.cols());
    cholmod_free_dense(&X, &common_);
    return result;
  }

  /// tr D for a diagonal D >= 0 with A + shift I + D >= L L^T in spite of rounding.
  ///
  /// L L^T = A + shift I + E with |E_ij| <= gamma_k (|L| |L|^T)_ij, where k - 1 is the number of
  /// nonzeros in row i of L (Higham 2002, Theorem 10.3, for any order of the operations). E is
  /// bounded by the diagonal matrix of its absolute row sums, which a pass over L gives.
  double rounding_trace() const {
    const std::size_t n = symbolic_->n;
    const int* const column_start = static_cast<int*>(factor_->p);
    const int* const column_size = static_cast<int*>(factor_->nz);
    const int* const row = static_cast<int*>(factor_->i);
    const double* const value = static_cast<double*>(factor_->x);
    std::vector<double> row_sum(n, 0.0);  // |L| |L|^T 1
    std::vector<int> row_size(n, 0);
    for (std::size_t j = 0; j < n; ++j) {
      const int begin = column_start[j];
      const int end = begin + column_size[j];
      double column_sum = 0.0;
      for (int k = begin; k < end; ++k) column_sum += std::abs(value[k]);
      for (int k = begin; k < end; ++k) {
        row_sum[row[k]] += std::abs(value[k]) * column_sum;
        ++row_size[row[k]];
      }
    }
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    double trace = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double k = row_size[i] + 1;
      trace += k * unit / (1.0 - k * unit) * row_sum[i];
    }
    return trace;
  }

 private:
  [[noreturn]] static void throw_error(int status) {
    if (status == CHOLMOD_TOO_LARGE) {
      throw std::length_error("the Cholesky factor is too large for its indices");
    }
    throw std::bad_alloc();
  }
  void check(bool succeeded) const {
    if (!succeeded) throw_error(common_.status);
  }

  /// CHOLMOD lets a NaN pass.
  bool has_positive_diagonal() const {
    const int* const column_start = static_cast<int*>(factor_->p);
    const double* const value = static_cast<double*>(factor_->x);
    for (std::size_t j = 0; j < symbolic_->n; ++j) {
      const double pivot = value[column_start[j]];
      if (!(pivot > 0.0) || !std::isfinite(pivot)) return false;
    }
    return true;
  }

  static cholmod_sparse view_of(const SparseSymmetric& A) {
    cholmod_sparse view{};
    view.nrow = static_cast<std::size_t>(A.rows());
    view.ncol = static_cast<std::size_t>(A.cols());
    view.nzmax = static_cast<std::size_t>(A.nonZeros());
    view.p = const_cast<int*>(A.outerIndexPtr());
    view.i = const_cast<int*>(A.innerIndexPtr());
    view.x = const_cast<double*>(A.valuePtr());
    view.stype = -1;  // lower triangle
    view.itype = CHOLMOD_INT;
    view.xtype = CHOLMOD_REAL;
    view.dtype = CHOLMOD_DOUBLE;
    view.sorted = 1;
    view.packed = 1;
    return view;
  }

  cholmod_common common_{};
  cholmod_factor* symbolic_ = nullptr;
  cholmod_factor* factor_ = nullptr;
  double flops_ = 0.0;
};

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

enum class CholeskyOutcome { positive_definite, not_positive_definite, stopped };

/// Sparse Cholesky factorisation, P (A + shift I) P^T = L L^T, of a matrix of B x B blocks by the
/// multifrontal method (Duff and Reid 1983; Liu 1992): supernode by supernode, children first, the
/// entries of its columns and what its children left over are summed into a dense front, whose
/// columns are factorised, and whose rest is left for the parent.
template <int B>
class BlockCholesky {
 public:
  using Blocks = std::vector<Eigen::Matrix<double, B, B>>;

  /// @param symbolic the analysis of the pattern that all matrices have
  explicit BlockCholesky(std::shared_ptr<const SymbolicCholesky> symbolic)
      : symbolic_(std::move(symbolic)) {
    std::size_t size = 0;
    for (const Supernode& node : symbolic_->supernodes()) {
      panel_start_.push_back(size);
      size += B * node.rows() * (B * node.columns());
    }
    panels_.resize(size);
  }

  const std::shared_ptr<const SymbolicCholesky>& symbolic() const { return symbolic_; }
  /// Number of scalar rows.
  Eigen::Index size() const { return B * static_cast<Eigen::Index>(symbolic_->size()); }

  /// @param A the blocks of the lower triangle, in the order of BlockPattern::row; diagonal blocks
  ///        are symmetric
  /// @param keep_going asked every few milliseconds; false stops
  CholeskyOutcome factorize(const Blocks& A, double shift = 0.0,
                            const std::function<bool()>& keep_going = {}) {
    const auto& supernodes = symbolic_->supernodes();
    std::vector<std::vector<std::pair<Index, std::size_t>>> left_over(supernodes.size());
    std::vector<Index> place(static_cast<std::size_t>(symbolic_->size()));  // of a row in the front
    std::size_t top = 0;  // of the stack of what is left over
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      if (keep_going && !keep_going()) return CholeskyOutcome::stopped;
      const Supernode& node = supernodes[s];
      const Index pivots = B * node.columns(), below = B * node.num_below();
      const std::size_t rest_size = static_cast<std::size_t>(below) * below;
      if (stack_.size() < top + rest_size) stack_.resize(std::max(2 * stack_.size(), top + rest_size));
      const Front front{panels_.data() + panel_start_[s], pivots, below, stack_.data() + top};
      std::fill_n(front.panel, static_cast<std::size_t>(pivots) * (pivots + below), 0.0);
      std::fill_n(front.rest, rest_size, 0.0);

      Index next_place = 0;
      for (Index k = node.begin; k < node.end; ++k) place[k] = next_place++;
      for (const Index row : node.below) place[row] = next_place++;
      for (Index k = node.begin; k < node.end; ++k) {
        for (auto e = symbolic_->entries_begin(k); e != symbolic_->entries_end(k); ++e) {
          auto target = front.block(place[e->row], place[k]);
          if (e->transposed) {
            target += A[e->index].transpose();
          } else {
            target += A[e->index];
          }
        }
        if (shift != 0.0) front.block(place[k], place[k]).diagonal().array() += shift;
      }
      std::size_t base = top;
      for (const auto& [child, start] : left_over[s]) {
        front.add(supernodes[child].below, place, stack_.data() + start);
        base = std::min(base, start);
      }

      if (!partial_cholesky_(front.panel, pivots, below, front.rest, keep_going)) {
        const bool stopped = keep_going && !keep_going();
        return stopped ? CholeskyOutcome::stopped : CholeskyOutcome::not_positive_definite;
      }
      // The rest takes the place of what the children left over.
      if (below > 0) {
        std::copy_n(stack_.data() + top, base < top ? rest_size : 0, stack_.data() + base);
        left_over[node.parent].emplace_back(static_cast<Index>(s), base);
      }
      top = base + rest_size;
    }
    return CholeskyOutcome::positive_definite;
  }

  /// X <- (A + shift I)^-1 X, after a factorisation that was positive definite.
  /// @param X size() rows, in the order of the nodes
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> X) {
    const auto& supernodes = symbolic_->supernodes();
    const auto& node = symbolic_->node();
    permuted_.resize(X.rows(), X.cols());
    for (Index k = 0; k < symbolic_->size(); ++k) {
      permuted_.middleRows<B>(B * k) = X.middleRows<B>(B * node[k]);
    }
    for (std::size_t s = 0; s < supernodes.size(); ++s) solve_lower(s);
    for (std::size_t s = supernodes.size(); s-- > 0;) solve_upper(s);
    for (Index k = 0; k < symbolic_->size(); ++k) {
      X.middleRows<B>(B * node[k]) = permuted_.middleRows<B>(B * k);
    }
  }
  Eigen::MatrixXd solve(Eigen::MatrixXd X) {
    solve_in_place(X);
    return X;
  }

  /// tr D for a diagonal D >= 0 with A + shift I + D >= L L^T in spite of rounding.
  ///
  /// L L^T = A + shift I + E with |E_ij| <= u k_ij / (1 - u k_ij) (|L| |L|^T)_ij, where k_ij is one
  /// more than the number of products that were subtracted (Higham 2002, Theorem 10.3, for any
  /// order of the operations). With k_i the number of nonzeros in row i of L and one,
  /// k_ij <= sqrt(k_i k_j), so |E| <= u' sum_c a_c a_c^T with a_c = (sqrt(k_i) |L_ic|)_i; and
  /// a a^T <= diag(a) sum_i a_i, whose trace is (sum_i a_i)^2.
  double rounding_trace() const {
    const auto& supernodes = symbolic_->supernodes();
    std::vector<double> row_size(static_cast<std::size_t>(symbolic_->size()), 1.0);
    for (const Supernode& node : supernodes) {
      for (Index k = node.begin; k < node.end; ++k) row_size[k] += B * (k - node.begin + 1.0);
      for (const Index row : node.below) row_size[row] += B * node.columns();
    }
    double trace = 0.0, largest = 0.0;
    std::vector<double> root;
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      const auto rows = static_cast<Index>(node.rows());
      root.resize(static_cast<std::size_t>(rows));
      for (Index r = 0; r < rows; ++r) {
        const Index row = r < node.columns() ? node.begin + r : node.below[r - node.columns()];
        root[r] = std::sqrt(row_size[row]);
        largest = std::max(largest, row_size[row]);
      }
      const double* column = panels_.data() + panel_start_[s];
      for (Index c = 0; c < B * node.columns(); ++c, column += B * rows) {
        double sum = 0.0;
        for (Index i = c; i < B * rows; ++i) sum += root[i / B] * std::abs(column[i]);
        trace += sum * sum;
      }
    }
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    return unit / (1.0 - unit * largest) * trace;
  }

 private:
  using Supernode = SymbolicCholesky::Supernode;
  using Stride = Eigen::OuterStride<>;
  using MatrixView = Eigen::Map<const Eigen::MatrixXd, 0, Stride>;

  /// A dense front: [A11; A21] in the panel, A22 in the rest.
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
    using BlockView = Eigen::Map<Eigen::Matrix<double, B, B>, 0, Stride>;
    BlockView block(Index row, Index column) const {
      const Index height = pivots + below;
      return BlockView(this->column(B * column) + B * row, Stride(height));
    }
    /// Adds what a child left over: the lower triangle of a matrix with these rows.
    void add(const std::vector<Index>& rows, const std::vector<Index>& place,
             const double* child) const {
      const std::size_t height = B * rows.size();
      for (std::size_t c = 0; c < rows.size(); ++c) {
        for (int k = 0; k < B; ++k, child += height) {
          double* const target = column(B * place[rows[c]] + k);
          for (std::size_t r = c; r < rows.size(); ++r) {
            double* const out = target + B * place[rows[r]];
            const double* const in = child + B * r;
            for (int i = 0; i < B; ++i) out[i] += in[i];
          }
        }
      }
    }
  };

  void solve_lower(std::size_t s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const auto height = static_cast<Eigen::Index>(B * node.rows());
    const Eigen::Index pivots = B * node.columns(), below = height - pivots;
    const MatrixView L(panels_.data() + panel_start_[s], height, pivots, Stride(height));
    front_.resize(below, 1);
    for (Eigen::Index t = 0; t < permuted_.cols(); ++t) {
      auto x = permuted_.col(t).segment(B * node.begin, pivots);
      front_.setZero();
      for (Eigen::Index c = 0; c < pivots; ++c) {
        x(c) /= L(c, c);
        x.tail(pivots - c - 1) -= x(c) * L.col(c).segment(c + 1, pivots - c - 1);
        front_.col(0) += x(c) * L.col(c).tail(below);
      }
      for (Index r = 0; r < node.num_below(); ++r) {
        permuted_.col(t).template segment<B>(B * node.below[r]) -=
            front_.col(0).template segment<B>(B * r);
      }
    }
  }

  void solve_upper(std::size_t s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const auto height = static_cast<Eigen::Index>(B * node.rows());
    const Eigen::Index pivots = B * node.columns(), below = height - pivots;
    const MatrixView L(panels_.data() + panel_start_[s], height, pivots, Stride(height));
    front_.resize(below, 1);
    for (Eigen::Index t = 0; t < permuted_.cols(); ++t) {
      auto x = permuted_.col(t).segment(B * node.begin, pivots);
      for (Index r = 0; r < node.num_below(); ++r) {
        front_.col(0).template segment<B>(B * r) =
            permuted_.col(t).template segment<B>(B * node.below[r]);
      }
      for (Eigen::Index c = pivots - 1; c >= 0; --c) {
        const double known = L.col(c).segment(c + 1, pivots - c - 1).dot(x.tail(pivots - c - 1)) +
                             L.col(c).tail(below).dot(front_.col(0));
        x(c) = (x(c) - known) / L(c, c);
      }
    }
  }

  std::shared_ptr<const SymbolicCholesky> symbolic_;
  std::vector<std::size_t> panel_start_;
  std::vector<double> panels_;  // of every supernode: its columns of L, column-major
  std::vector<double> stack_;
  Eigen::MatrixXd permuted_, front_;
  PartialCholesky partial_cholesky_;
};

}  // namespace rotavg

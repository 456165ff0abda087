#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/buffer.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/multifrontal.hpp>
#include <rotavg/linalg/subtrees.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Sparse Cholesky factorisation, P (A + shift I) P^T = L L^T, of a matrix of B x B blocks by the
/// multifrontal method, and what is solved with it.
template <int B>
class BlockCholesky {
 public:
  using Blocks = typename Multifrontal<B>::Blocks;
  using MatrixView = Eigen::Map<const Eigen::MatrixXd>;

  /// @param symbolic the analysis of the pattern that all matrices have
  /// @param num_threads at most so many, where there is work for them; the result is the same
  explicit BlockCholesky(std::shared_ptr<const SymbolicCholesky> symbolic, int num_threads = 1)
      : symbolic_(std::move(symbolic)),
        num_threads_(num_threads),
        fronts_(symbolic_, num_threads),
        vectors_(*symbolic_, fronts_.subtrees(),
                 [](const Supernode& node) { return B * node.below.size(); }) {
    std::size_t size = 0;
    for (const Supernode& node : symbolic_->supernodes()) {
      panel_start_.push_back(size);
      size += B * node.rows() * (B * node.columns());
      most_rows_ = std::max(most_rows_, node.rows());
      entries_ += static_cast<double>(node.rows()) * node.columns();
    }
    panels_ = Buffer(size);
    left_over_.resize(together, vectors_.size);
  }

  const std::shared_ptr<const SymbolicCholesky>& symbolic() const { return symbolic_; }
  /// Number of scalar rows.
  Eigen::Index size() const { return B * static_cast<Eigen::Index>(symbolic_->size()); }

  /// The columns of L that supernode s has, in its rows: first its own, in a lower triangle whose
  /// upper part has no meaning, and then those below.
  MatrixView factor(std::size_t s) const {
    const Supernode& node = symbolic_->supernodes()[s];
    return MatrixView(panels_.data() + panel_start_[s], B * node.rows(), B * node.columns());
  }

  /// @param A the blocks of the lower triangle, in the order of BlockPattern::row; diagonal blocks
  ///        are symmetric
  /// @param keep_going asked every few milliseconds, on this thread; false stops
  CholeskyOutcome factorize(const Blocks& A, double shift = 0.0,
                            const std::function<bool()>& keep_going = {}) {
    return fronts_.factorize(A, shift, keep_going, [this] {
      return [this](Index s) { return panels_.data() + panel_start_[s]; };
    });
  }

  /// X <- (A + shift I)^-1 X, after a factorisation that was positive definite.
  /// @param X size() rows, in the order of the nodes
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> X) {
    for (Eigen::Index first = 0; first < X.cols(); first += together) {
      auto columns = X.middleCols(first, std::min<Eigen::Index>(together, X.cols() - first));
      solve_entries(
          static_cast<int>(columns.cols()), [&](Index row, int t) { return columns(row, t); },
          [&](Index row, int t, double solved) { columns(row, t) = solved; });
    }
  }
  /// The same for at most four columns that may stand anywhere.
  /// @param read `double read(row, column)`
  /// @param write `write(row, column, solved)`
  template <typename Read, typename Write>
  void solve_entries(int columns, Read&& read, Write&& write) {
    const int num_threads = threads_for(num_threads_, 2.0 * together * B * B * entries_);
    const auto& node = symbolic_->node();
    const auto below = [this] { return RightHandSides(together, B * most_rows_); };
    permuted_.resize(together, size());
    parallel_for(symbolic_->size(), num_threads, [&](Index k) {
      for (int i = 0; i < B; ++i) {
        for (int t = 0; t < together; ++t) {
          permuted_(t, B * k + i) = t < columns ? read(B * node[k] + i, t) : 0.0;
        }
      }
    });
    fronts_.subtrees().rise(
        num_threads,
        [&](const Subtrees::Range& range) {
          for (Index s = range.begin; s < range.end; ++s) solve_lower(s);
        },
        [&](Index s) { solve_lower(s); }, [] {});
    fronts_.subtrees().descend(
        num_threads,
        [&](const Subtrees::Range& range) {
          RightHandSides rest = below();
          for (Index s = range.end; s-- > range.begin;) solve_upper(s, rest);
        },
        [&, rest = below()](Index s) mutable { solve_upper(s, rest); });
    parallel_for(symbolic_->size(), num_threads, [&](Index k) {
      for (int i = 0; i < B; ++i) {
        for (int t = 0; t < columns; ++t) write(B * node[k] + i, t, permuted_(t, B * k + i));
      }
    });
  }
  Eigen::MatrixXd solve(Eigen::MatrixXd X) {
    solve_in_place(X);
    return X;
  }

  /// tr D for a diagonal D >= 0 with A + shift I + D >= L L^T in spite of rounding.
  double rounding_trace() const {
    return rotavg::rounding_trace<B>(*symbolic_, [this](std::size_t s) { return factor(s); });
  }

 private:
  /// Right-hand sides are solved four at a time, so that L is read once for all of them; where
  /// there are fewer, the others are zero. Their rows stand in columns.
  static constexpr int together = 4;
  using Row = Eigen::Matrix<double, together, 1>;
  using RightHandSides = Eigen::Matrix<double, together, Eigen::Dynamic>;

  /// X <- L^-1 X in the columns of one supernode, and what they take from the rows below, which is
  /// left over for the parent. Two columns at once halve the traffic of X.
  ROTAVG_ONE_COPY void solve_lower(Index s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const MatrixView L = factor(s);
    const Eigen::Index pivots = L.cols(), below = L.rows() - pivots;
    auto x = permuted_.middleCols(B * node.begin, pivots);
    auto rest = left_over_.middleCols(vectors_.front[s], below);
    rest.setZero();
    symbolic_->for_each_child(s, [&](Index child) {
      const std::vector<Index>& places = symbolic_->supernodes()[child].in_parent;
      const double* from = left_over_.col(vectors_.left_over[child]).data();
      for (const Index place : places) {
        double* const to = B * place < pivots ? x.data() + together * (B * place)
                                              : rest.data() + together * (B * place - pivots);
        for (int i = 0; i < together * B; ++i) to[i] += from[i];
        from += together * B;
      }
    });
    for (Eigen::Index c = 0; c < pivots; c += 2) {
      const double* const l = L.col(c).data();
      const double* const l_below = l + pivots;
      const Row x_c = x.col(c) /= l[c];
      if (c + 1 == pivots) {
        for (Eigen::Index r = 0; r < below; ++r) rest.col(r) -= l_below[r] * x_c;
        break;
      }
      const double* const next_l = l + L.rows();
      const double* const next_l_below = next_l + pivots;
      const Row next_x = (x.col(c + 1) -= l[c + 1] * x_c) /= next_l[c + 1];
      for (Eigen::Index r = c + 2; r < pivots; ++r) x.col(r) -= l[r] * x_c + next_l[r] * next_x;
      for (Eigen::Index r = 0; r < below; ++r) {
        rest.col(r) -= l_below[r] * x_c + next_l_below[r] * next_x;
      }
    }
    // It takes the place of what the children left over.
    if (vectors_.left_over[s] != vectors_.front[s]) {
      std::copy_n(rest.data(), rest.size(), left_over_.col(vectors_.left_over[s]).data());
    }
  }

  /// X <- L^-T X in the columns of one supernode, where the rows below are solved.
  /// @param rest room for these
  ROTAVG_ONE_COPY void solve_upper(Index s, RightHandSides& rest) {
    const Supernode& node = symbolic_->supernodes()[s];
    const MatrixView L = factor(s);
    const Eigen::Index pivots = L.cols(), below = L.rows() - pivots;
    auto x = permuted_.middleCols(B * node.begin, pivots);
    for (Index r = 0; r < node.num_below(); ++r) {
      rest.template middleCols<B>(B * r) = permuted_.template middleCols<B>(B * node.below[r]);
    }
    for (Eigen::Index c = pivots - 1; c >= 0; c -= 2) {
      const double* const l = L.col(c).data();
      const double* const l_below = l + pivots;
      Row x_c = x.col(c);
      if (c == 0) {
        for (Eigen::Index r = 1; r < pivots; ++r) x_c -= l[r] * x.col(r);
        for (Eigen::Index r = 0; r < below; ++r) x_c -= l_below[r] * rest.col(r);
        x.col(0) = x_c / l[0];
        break;
      }
      const double* const previous_l = l - L.rows();
      const double* const previous_l_below = previous_l + pivots;
      Row previous_x = x.col(c - 1);
      for (Eigen::Index r = c + 1; r < pivots; ++r) {
        x_c -= l[r] * x.col(r);
        previous_x -= previous_l[r] * x.col(r);
      }
      for (Eigen::Index r = 0; r < below; ++r) {
        x_c -= l_below[r] * rest.col(r);
        previous_x -= previous_l_below[r] * rest.col(r);
      }
      x_c /= l[c];
      x.col(c) = x_c;
      x.col(c - 1) = (previous_x - previous_l[c] * x_c) / previous_l[c - 1];
    }
  }

  std::shared_ptr<const SymbolicCholesky> symbolic_;
  int num_threads_;
  Multifrontal<B> fronts_;
  FrontStacks vectors_;  // of solutions
  std::vector<std::size_t> panel_start_;
  std::size_t most_rows_ = 0;
  double entries_ = 0.0;  // of L, in blocks
  Buffer panels_;         // of every supernode: its columns of L, column-major
  RightHandSides permuted_, left_over_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

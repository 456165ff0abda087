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

#include <rotavg/linalg/buffer.hpp>
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
    const auto& supernodes = symbolic_->supernodes();
    std::vector<std::size_t> left_over(supernodes.size(), 0);  // by the children
    std::size_t size = 0, top = 0, highest = 0;
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      panel_start_.push_back(size);
      size += B * node.rows() * (B * node.columns());
      const std::size_t rest = B * node.below.size() * (B * node.below.size());
      highest = std::max(highest, top + rest);
      top += rest - left_over[s];
      if (node.parent >= 0) left_over[node.parent] += rest;
    }
    panels_ = Buffer(size);
    stack_ = Buffer(highest);
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
    constexpr double often_enough = 1e7;  // operations between two questions
    double unasked = 2.0 * often_enough;
    std::size_t top = 0;  // of the stack of what is left over
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      const Index pivots = B * node.columns(), below = B * node.num_below();
      const double operations = double(pivots) * (pivots + below) * (pivots + below);
      unasked += operations;
      if (unasked > often_enough && keep_going) {
        if (!keep_going()) return CholeskyOutcome::stopped;
        unasked = 0.0;
      }
      const std::size_t rest_size = static_cast<std::size_t>(below) * below;
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

      const bool large = operations > often_enough;
      if (!partial_cholesky_(front.panel, pivots, below, front.rest,
                             large ? keep_going : std::function<bool()>())) {
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
    const auto& node = symbolic_->node();
    const auto num_supernodes = static_cast<Index>(symbolic_->supernodes().size());
    rows_.resize(static_cast<std::size_t>(size()));
    for (Eigen::Index first = 0; first < X.cols(); first += lanes) {
      const Eigen::Index columns = std::min<Eigen::Index>(lanes, X.cols() - first);
      for (Index k = 0; k < symbolic_->size(); ++k) {
        for (int i = 0; i < B; ++i) {
          rows_[B * k + i].setZero();
          for (Eigen::Index t = 0; t < columns; ++t) {
            rows_[B * k + i](t) = X(B * node[k] + i, first + t);
          }
        }
      }
      for (Index s = 0; s < num_supernodes; ++s) solve_lower(s);
      for (Index s = num_supernodes; s-- > 0;) solve_upper(s);
      for (Index k = 0; k < symbolic_->size(); ++k) {
        for (int i = 0; i < B; ++i) {
          for (Eigen::Index t = 0; t < columns; ++t) {
            X(B * node[k] + i, first + t) = rows_[B * k + i](t);
          }
        }
      }
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
    Eigen::VectorXd root;
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      const auto rows = static_cast<Index>(node.rows());
      root.resize(B * rows);
      for (Index r = 0; r < rows; ++r) {
        const Index row = r < node.columns() ? node.begin + r : node.below[r - node.columns()];
        root.segment<B>(B * r).setConstant(std::sqrt(row_size[row]));
        largest = std::max(largest, row_size[row]);
      }
      const double* column = panels_.data() + panel_start_[s];
      for (Index c = 0; c < B * node.columns(); ++c, column += B * rows) {
        const Index height = B * rows - c;
        const Eigen::Map<const Eigen::VectorXd> L_c(column + c, height);
        const double sum = root.tail(height).dot(L_c.cwiseAbs());
        trace += sum * sum;
      }
    }
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    return unit / (1.0 - unit * largest) * trace;
  }

 private:
  using Supernode = SymbolicCholesky::Supernode;
  using Stride = Eigen::OuterStride<>;
  // Right-hand sides are solved for four at a time.
  static constexpr int lanes = 4;
  using Lanes = Eigen::Array<double, lanes, 1>;

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

  void solve_lower(Index s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const Index pivots = B * node.columns(), below = B * node.num_below();
    const double* L = panels_.data() + panel_start_[s];
    Lanes* const x = rows_.data() + B * node.begin;
    front_.assign(static_cast<std::size_t>(below), Lanes::Zero());
    for (Index c = 0; c < pivots; ++c, L += pivots + below) {
      const Lanes x_c = x[c] /= L[c];
      for (Index r = c + 1; r < pivots; ++r) x[r] -= L[r] * x_c;
      for (Index r = 0; r < below; ++r) front_[r] += L[pivots + r] * x_c;
    }
    for (Index r = 0; r < below; ++r) rows_[B * node.below[r / B] + r % B] -= front_[r];
  }

  void solve_upper(Index s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const Index pivots = B * node.columns(), below = B * node.num_below();
    Lanes* const x = rows_.data() + B * node.begin;
    front_.resize(static_cast<std::size_t>(below));
    for (Index r = 0; r < below; ++r) front_[r] = rows_[B * node.below[r / B] + r % B];
    for (Index c = pivots - 1; c >= 0; --c) {
      const double* const L =
          panels_.data() + panel_start_[s] + static_cast<std::size_t>(c) * (pivots + below);
      Lanes even = Lanes::Zero(), odd = Lanes::Zero();  // two chains of additions, for speed
      for (Index r = c + 1; r < pivots; ++r) even += L[r] * x[r];
      Index r = 0;
      for (; r + 1 < below; r += 2) {
        even += L[pivots + r] * front_[r];
        odd += L[pivots + r + 1] * front_[r + 1];
      }
      if (r < below) even += L[pivots + r] * front_[r];
      x[c] = (x[c] - even - odd) / L[c];
    }
  }

  std::shared_ptr<const SymbolicCholesky> symbolic_;
  std::vector<std::size_t> panel_start_;
  Buffer panels_;                    // of every supernode: its columns of L, column-major
  Buffer stack_;                     // of what is left over for parents
  std::vector<Lanes> rows_, front_;  // of right-hand sides, in the order of elimination
  PartialCholesky partial_cholesky_;
};

}  // namespace rotavg

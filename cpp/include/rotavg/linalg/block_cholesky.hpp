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
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Sparse Cholesky factorisation, P (A + shift I) P^T = L L^T, of a matrix of B x B blocks by the
/// multifrontal method (Duff and Reid 1983; Liu 1992): supernode by supernode, children first, the
/// entries of its columns and what its children left over are summed into a dense front, whose
/// columns are factorised, and whose rest is left for the parent.
template <int B>
class BlockCholesky {
 public:
  using Blocks = std::vector<Eigen::Matrix<double, B, B>>;
  using Supernode = SymbolicCholesky::Supernode;
  using MatrixView = Eigen::Map<const Eigen::MatrixXd>;

  /// @param symbolic the analysis of the pattern that all matrices have
  explicit BlockCholesky(std::shared_ptr<const SymbolicCholesky> symbolic)
      : symbolic_(std::move(symbolic)) {
    const auto& supernodes = symbolic_->supernodes();
    std::vector<std::size_t> left_over(supernodes.size(), 0);  // by the children
    std::size_t size = 0, most_rows = 0, top = 0, highest = 0;
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      panel_start_.push_back(size);
      size += B * node.rows() * (B * node.columns());
      most_rows = std::max(most_rows, node.rows());
      const std::size_t rest = B * node.below.size() * (B * node.below.size());
      highest = std::max(highest, top + rest);
      top += rest - left_over[s];
      if (node.parent >= 0) left_over[node.parent] += rest;
    }
    panels_ = Buffer(size);
    stack_ = Buffer(highest);
    front_.resize(together, B * most_rows);
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
  /// @param keep_going asked every few milliseconds; false stops
  CholeskyOutcome factorize(const Blocks& A, double shift = 0.0,
                            const std::function<bool()>& keep_going = {}) {
    const auto& supernodes = symbolic_->supernodes();
    // Where each row stands in the front.
    std::vector<Index> place(static_cast<std::size_t>(symbolic_->size()));
    std::vector<LeftOver> left_over;  // on the stack
    std::size_t top = 0;              // of the stack
    if (keep_going && !keep_going()) return CholeskyOutcome::stopped;
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      const Index pivots = B * node.columns(), below = B * node.num_below();
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
      // In postorder, what the children left over is what the stack has on top.
      std::size_t base = top;
      for (; !left_over.empty() && left_over.back().node->parent == static_cast<Index>(s);
           left_over.pop_back()) {
        base = left_over.back().start;
        front.add(left_over.back().node->below, place, stack_.data() + base);
      }

      const auto outcome = partial_cholesky_(front.panel, pivots, below, front.rest, keep_going);
      if (outcome != CholeskyOutcome::positive_definite) return outcome;
      // The rest takes the place of what the children left over.
      if (base < top) std::copy_n(stack_.data() + top, rest_size, stack_.data() + base);
      if (below > 0) left_over.push_back({&node, base});
      top = base + rest_size;
    }
    return CholeskyOutcome::positive_definite;
  }

  /// X <- (A + shift I)^-1 X, after a factorisation that was positive definite.
  /// @param X size() rows, in the order of the nodes
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> X) {
    const auto num_supernodes = symbolic_->supernodes().size();
    const auto& node = symbolic_->node();
    for (Eigen::Index first = 0; first < X.cols(); first += together) {
      auto columns = X.middleCols(first, std::min<Eigen::Index>(together, X.cols() - first));
      permuted_.setZero(together, X.rows());
      const auto for_each_entry = [&](auto&& f) {
        for (Index k = 0; k < symbolic_->size(); ++k) {
          for (int i = 0; i < B; ++i) {
            for (Eigen::Index t = 0; t < columns.cols(); ++t) {
              f(columns(B * node[k] + i, t), permuted_(t, B * k + i));
            }
          }
        }
      };
      for_each_entry([](const double& given, double& entry) { entry = given; });
      for (std::size_t s = 0; s < num_supernodes; ++s) solve_lower(s);
      for (std::size_t s = num_supernodes; s-- > 0;) solve_upper(s);
      for_each_entry([](double& solved, const double& entry) { solved = entry; });
    }
  }
  Eigen::MatrixXd solve(Eigen::MatrixXd X) {
    solve_in_place(X);
    return X;
  }

  /// tr D for a diagonal D >= 0 with A + shift I + D >= L L^T in spite of rounding.
  ///
  /// L L^T = A + shift I + E with |E_ij| <= u k_ij / (1 - u k_ij) (|L| |L|^T)_ij, where k_ij is at
  /// most the number of products that were subtracted and three, for the shift and the root (Higham
  /// 2002, Theorem 10.3, for any order of the operations). With k_i the number of nonzeros in row i
  /// of L and two, k_ij <= sqrt(k_i k_j), so |E| <= u' sum_c a_c a_c^T with a_c = (sqrt(k_i)
  /// |L_ic|)_i; and a a^T <= diag(a) sum_i a_i, whose trace is (sum_i a_i)^2.
  double rounding_trace() const {
    const auto& supernodes = symbolic_->supernodes();
    std::vector<double> row_size(static_cast<std::size_t>(symbolic_->size()), 2.0);
    for (const Supernode& node : supernodes) {
      for (Index k = node.begin; k < node.end; ++k) row_size[k] += B * (k - node.begin + 1.0);
      for (const Index row : node.below) row_size[row] += B * node.columns();
    }
    double trace = 0.0, largest = 0.0;
    Eigen::VectorXd root(front_.cols());  // as long as the longest column
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      const Supernode& node = supernodes[s];
      const auto rows = static_cast<Index>(node.rows());
      for (Index r = 0; r < rows; ++r) {
        const Index row = r < node.columns() ? node.begin + r : node.below[r - node.columns()];
        root.segment<B>(B * r).setConstant(std::sqrt(row_size[row]));
        largest = std::max(largest, row_size[row]);
      }
      const MatrixView L = factor(s);
      for (Eigen::Index c = 0; c < L.cols(); ++c) {
        const Eigen::Index size = B * rows - c;
        const double sum = root.segment(c, size).dot(L.col(c).tail(size).cwiseAbs());
        trace += sum * sum;
      }
    }
    return unit_roundoff / (1.0 - unit_roundoff * largest) * trace;
  }

 private:
  /// What a supernode left over for its parent: the lower triangle of a matrix with the rows below
  /// it.
  struct LeftOver {
    const Supernode* node;
    std::size_t start;  // on the stack
  };

  /// Right-hand sides are solved four at a time, so that L is read once for all of them; where
  /// there are fewer, the others are zero. Their rows stand in columns.
  static constexpr int together = 4;
  using Row = Eigen::Matrix<double, together, 1>;
  using RightHandSides = Eigen::Matrix<double, together, Eigen::Dynamic>;

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
    /// A block of the panel.
    using BlockView = Eigen::Map<Eigen::Matrix<double, B, B>, 0, Eigen::OuterStride<>>;
    BlockView block(Index row, Index column) const {
      return BlockView(this->column(B * column) + B * row, Eigen::OuterStride<>(pivots + below));
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

  /// X <- L^-1 X in the columns of one supernode, and what they take from the rows below. Two
  /// columns at once halve the traffic of X.
  void solve_lower(std::size_t s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const MatrixView L = factor(s);
    const Eigen::Index pivots = L.cols(), rows = L.rows();
    auto x = front_.leftCols(rows);
    x.leftCols(pivots) = permuted_.middleCols(B * node.begin, pivots);
    x.rightCols(rows - pivots).setZero();
    for (Eigen::Index c = 0; c < pivots; c += 2) {
      const double* const l = L.col(c).data();
      const Row x_c = x.col(c) /= l[c];
      if (c + 1 == pivots) {
        for (Eigen::Index r = c + 1; r < rows; ++r) x.col(r) -= l[r] * x_c;
        break;
      }
      const double* const next_l = l + rows;
      const Row next_x = (x.col(c + 1) -= l[c + 1] * x_c) /= next_l[c + 1];
      for (Eigen::Index r = c + 2; r < rows; ++r) x.col(r) -= l[r] * x_c + next_l[r] * next_x;
    }
    permuted_.middleCols(B * node.begin, pivots) = x.leftCols(pivots);
    for (Index r = 0; r < node.num_below(); ++r) {
      permuted_.template middleCols<B>(B * node.below[r]) +=
          x.template middleCols<B>(pivots + B * r);
    }
  }

  /// X <- L^-T X in the columns of one supernode, where the rows below are solved.
  void solve_upper(std::size_t s) {
    const Supernode& node = symbolic_->supernodes()[s];
    const MatrixView L = factor(s);
    const Eigen::Index pivots = L.cols(), rows = L.rows();
    auto x = front_.leftCols(rows);
    x.leftCols(pivots) = permuted_.middleCols(B * node.begin, pivots);
    for (Index r = 0; r < node.num_below(); ++r) {
      x.template middleCols<B>(pivots + B * r) =
          permuted_.template middleCols<B>(B * node.below[r]);
    }
    for (Eigen::Index c = pivots - 1; c >= 0; c -= 2) {
      const double* const l = L.col(c).data();
      Row x_c = x.col(c);
      if (c == 0) {
        for (Eigen::Index r = 1; r < rows; ++r) x_c -= l[r] * x.col(r);
        x.col(0) = x_c / l[0];
        break;
      }
      const double* const previous_l = l - rows;
      Row previous_x = x.col(c - 1);
      for (Eigen::Index r = c + 1; r < rows; ++r) {
        x_c -= l[r] * x.col(r);
        previous_x -= previous_l[r] * x.col(r);
      }
      x_c /= l[c];
      x.col(c) = x_c;
      x.col(c - 1) = (previous_x - previous_l[c] * x_c) / previous_l[c - 1];
    }
    permuted_.middleCols(B * node.begin, pivots) = x.leftCols(pivots);
  }

  std::shared_ptr<const SymbolicCholesky> symbolic_;
  std::vector<std::size_t> panel_start_;
  Buffer panels_;                    // of every supernode: its columns of L, column-major
  Buffer stack_;                     // of what is left over for parents
  RightHandSides permuted_, front_;  // of all rows, and those of one supernode
  PartialCholesky partial_cholesky_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/add_product.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/buffer.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The blocks of A^-1 where the factor L of A = L L^T has entries, without the rest of the inverse
/// (Takahashi, Fagan and Chin 1973; Erisman and Tinney 1975), supernode by supernode, parents
/// first. With J the columns of a supernode and K the rows below them, Y = L_KJ L_JJ^-1 and Z =
/// A^-1,
///
///     Z_KJ = -Z_KK Y,     Z_JJ = (L_JJ L_JJ^T)^-1 - Y^T Z_KJ,
///
/// and all of Z_KK stands in the columns of ancestors.
template <int B>
class SelectedInverse {
 public:
  using Block = Eigen::Matrix<double, B, B>;

  /// @param cholesky factorised and positive definite
  /// @param keep_going asked before every supernode; false stops
  explicit SelectedInverse(const BlockCholesky<B>& cholesky,
                           const std::function<bool()>& keep_going = {})
      : symbolic_(cholesky.symbolic()) {
    const auto& supernodes = symbolic_->supernodes();
    supernode_of_.resize(static_cast<std::size_t>(symbolic_->size()));
    column_of_.resize(supernode_of_.size());
    place_.resize(supernode_of_.size());
    std::size_t size = 0;
    for (std::size_t s = 0; s < supernodes.size(); ++s) {
      panel_start_.push_back(size);
      size += B * supernodes[s].rows() * (B * supernodes[s].columns());
      std::fill(supernode_of_.begin() + supernodes[s].begin,
                supernode_of_.begin() + supernodes[s].end, static_cast<Index>(s));
    }
    for (Index k = 0; k < symbolic_->size(); ++k) column_of_[symbolic_->node()[k]] = k;
    panels_ = Buffer(size);
    for (std::size_t s = supernodes.size(); s-- > 0 && !stopped_;) {
      stopped_ = keep_going && !keep_going();
      if (!stopped_) invert(s, cholesky.factor(s));
    }
  }

  /// Whether the work was stopped, so that nothing here has a meaning.
  bool stopped() const { return stopped_; }

  /// Whether the factor has an entry in the row of node a and the column of node b, or the other
  /// way round.
  bool has(Index a, Index b) const {
    const auto [column, row] = std::minmax(column_of_[a], column_of_[b]);
    return place_in(supernode_of_[column], row) >= 0;
  }

  /// The block of A^-1 in the row of node a and the column of node b.
  /// @pre has(a, b)
  Block operator()(Index a, Index b) const {
    const auto [column, row] = std::minmax(column_of_[a], column_of_[b]);
    const Index s = supernode_of_[column];
    const Block block = panel(s).template block<B, B>(
        B * place_in(s, row), B * (column - symbolic_->supernodes()[s].begin));
    return column_of_[a] == row ? block : Block(block.transpose());
  }

 private:
  using Supernode = SymbolicCholesky::Supernode;
  using PanelView = Eigen::Map<Eigen::MatrixXd>;
  using ConstPanelView = Eigen::Map<const Eigen::MatrixXd>;

  PanelView panel(std::size_t s) {
    const Supernode& node = symbolic_->supernodes()[s];
    return PanelView(panels_.data() + panel_start_[s], B * node.rows(), B * node.columns());
  }
  ConstPanelView panel(std::size_t s) const {
    const Supernode& node = symbolic_->supernodes()[s];
    return ConstPanelView(panels_.data() + panel_start_[s], B * node.rows(), B * node.columns());
  }

  /// Where a row stands in the panel of a supernode; -1 if it does not.
  Index place_in(std::size_t s, Index row) const {
    const Supernode& node = symbolic_->supernodes()[s];
    if (row < node.end) return row < node.begin ? -1 : row - node.begin;
    const auto found = std::lower_bound(node.below.begin(), node.below.end(), row);
    if (found == node.below.end() || *found != row) return -1;
    return node.columns() + static_cast<Index>(found - node.below.begin());
  }

  void invert(std::size_t s, const ConstPanelView& L) {
    const Supernode& node = symbolic_->supernodes()[s];
    const Eigen::Index pivots = L.cols(), below = L.rows() - pivots;
    const auto L_JJ = L.topRows(pivots).template triangularView<Eigen::Lower>();
    PanelView Z = panel(s);
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(pivots, pivots);
    L_JJ.solveInPlace(inverse);
    Z.setZero();
    add_product(1.0, Eigen::MatrixXd(inverse.transpose()), inverse, Z.topRows(pivots));
    if (below == 0) return;
    gather(node);
    Y_.setZero(below, pivots);
    add_product(1.0, L.bottomRows(below), inverse, Y_);
    add_product(-1.0, Z_KK_, Y_, Z.bottomRows(below));
    add_product(-1.0, Eigen::MatrixXd(Y_.transpose()), Z.bottomRows(below), Z.topRows(pivots));
  }

  /// Z_KK, K the rows below this supernode, from the panels of ancestors.
  void gather(const Supernode& node) {
    const auto& K = node.below;
    Z_KK_.resize(B * node.num_below(), B * node.num_below());
    Index ancestor = -1;
    for (std::size_t c = 0; c < K.size(); ++c) {
      const Index s = supernode_of_[K[c]];
      const Supernode& from = symbolic_->supernodes()[s];
      if (s != ancestor) {
        Index place = 0;
        for (Index k = from.begin; k < from.end; ++k) place_[k] = place++;
        for (const Index row : from.below) place_[row] = place++;
        ancestor = s;
      }
      const ConstPanelView Z = std::as_const(*this).panel(s);
      for (std::size_t r = c; r < K.size(); ++r) {
        const Block block = Z.template block<B, B>(B * place_[K[r]], B * (K[c] - from.begin));
        Z_KK_.template block<B, B>(B * r, B * c) = block;
        Z_KK_.template block<B, B>(B * c, B * r) = block.transpose();
      }
    }
  }

  std::shared_ptr<const SymbolicCholesky> symbolic_;
  std::vector<std::size_t> panel_start_;
  std::vector<Index> supernode_of_, column_of_;  // of every column; of every node
  Buffer panels_;                                // of every supernode: its columns of Z
  std::vector<Index> place_;                     // of rows in the panel of an ancestor
  Eigen::MatrixXd Z_KK_, Y_;
  bool stopped_ = false;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

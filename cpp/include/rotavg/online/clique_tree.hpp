#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/online/clique.hpp>
#include <rotavg/online/clique_forest.hpp>
#include <rotavg/online/clique_front.hpp>
#include <rotavg/online/clique_order.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The Cholesky factor of a matrix of 3 x 3 blocks that changes here and there, as a tree of
/// cliques (the Bayes tree of iSAM2, Kaess et al. 2012): where a variable changes, the cliques from
/// there to the root are eliminated anew, and the subtrees below stay as they are. With it
/// y = L^-1 K for a right-hand side of three columns, kept up in the same way.
///
/// At any time the factor is that of one Cholesky factorisation in one order, so the bound of
/// linalg/cholesky_rounding.hpp holds; what it takes from the diagonal of a row depends on the
/// subtree below that row alone.
///
/// @tparam System what is factorised, with
///         `degree(v)`, which no diagonal entry exceeds; `block_rounding(v)` and `mu(v)`, which are
///         taken from the diagonal, too; `diagonal(v)`; `for_each_neighbour(v, f)`, which calls
///         f(u); `for_each_entry(v, f)`, which calls f(u, block (v, u)), both perhaps several times
///         for a u (the blocks add up); `right_hand_side(v, side)`, a 3 x 3 block;
///         `right_hand_side_rounding(v)`, a bound on the norm of its error; `relative_gradient(v)`;
///         `dual_is_off(v)`, a 3 x 3 block that is summed over subtrees
template <typename System>
class CliqueTree : public CliqueForest {
 public:
  explicit CliqueTree(const System& system) : system_(system) {}

  void resize(Index num_variables) {
    CliqueForest::resize(num_variables);
    z_.resize(num_variables);
    rows_.resize(num_variables, Block::Zero());
  }

  /// A variable of each of the cliques that have most of |y|^2 for the bound: what the others have
  /// is no more than `rest`. The heaviest first.
  /// @param root a clique
  std::vector<Index> heaviest(const Clique& root, double rest) const {
    constexpr double hardly_any = 1e-3;  // of the rest, in a subtree
    std::vector<std::pair<double, Index>> shares;
    std::vector<const Clique*> stack{&root};
    while (!stack.empty()) {
      const Clique& clique = *stack.back();
      stack.pop_back();
      double own = clique.solution[for_bound].energy;
      for (const Index c : clique.children) {
        const Clique& child = cliques_[c];
        own -= child.solution[for_bound].energy;
        if (child.solution[for_bound].energy > hardly_any * rest) stack.push_back(&child);
      }
      shares.emplace_back(own, clique.columns.front());
    }
    std::sort(shares.rbegin(), shares.rend());
    double left = root.solution[for_bound].energy;
    std::vector<Index> variables;
    for (const auto& [own, v] : shares) {
      if (left <= rest) break;
      left -= own;
      variables.push_back(v);
    }
    return variables;
  }

  /// Eliminates what waits.
  /// @param last which of that is to stand near the root
  /// @returns whether all pivots were positive; otherwise all still waits
  bool eliminate(const std::vector<Index>& last) {
    if (pending_.empty()) return true;
    const std::vector<Index> made = plant(order_pending(last));
    for (const Index c : made) {
      if (factorize(system_, cliques_, cliques_[c], local_, dense_)) continue;
      for (const Index each : made) dissolve(each);
      return false;
    }
    settle(made);
    return true;
  }

  /// Brings y and the sums up to date.
  void solve_lower(RightHandSide side) {
    std::vector<Index>& ready = marked_[side];
    ready.erase(std::remove_if(ready.begin(), ready.end(),
                               [&](Index c) { return cliques_[c].solution[side].waiting > 0; }),
                ready.end());
    while (!ready.empty()) {
      const Index c = ready.back();
      ready.pop_back();
      Clique& clique = cliques_[c];
      if (!std::exchange(clique.solution[side].marked, false)) continue;  // done, or dissolved
      solve_lower(clique, side);
      const Index parent = clique.parent;
      if (parent >= 0 && --cliques_[parent].solution[side].waiting == 0) ready.push_back(parent);
    }
  }

  /// E^T (L L^T)^-1 E of three columns E that are zero but in the blocks of a few variables.
  /// @param E of each, which are in the tree
  Matrix3 compliance(const std::vector<std::pair<Index, Matrix3>>& E) {
    std::vector<Index> variables;
    for (const auto& [v, block] : E) {
      variables.push_back(v);
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) rows_[v](c, r) = block(r, c);
      }
    }
    Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
    for (const Index c : ways_up(variables)) {
      const Clique& clique = cliques_[c];
      const Index pivots = 3 * clique.num_columns();
      make_room(clique);
      for (Index r = 0; r < clique.num_rows(); ++r) {
        Block& row = rows_[clique.row(r)];
        x_.template middleCols<3>(3 * r) = row;
        row.setZero();
      }
      rotavg::solve_lower(clique, x_);
      for (Index k = 0; k < pivots; ++k) sum += x_.col(k) * x_.col(k).transpose();
      for (std::size_t r = 0; r < clique.below.size(); ++r) {
        rows_[clique.below[r]] = x_.template middleCols<3>(pivots + 3 * r);
      }
    }
    return sum.topLeftCorner<3, 3>();
  }

  /// Z = L^-T y, from the roots down; calls visit(v, Z_v), Z_v a 3 x 3 block.
  /// Left out are roots of which concerns(a variable) is false, and subtrees in which no gradient
  /// is larger than `gradient`, and which hang from variables that hardly move: no entry of Z is
  /// larger than `negligible` there.
  template <typename Concerns, typename Visit>
  void solve_upper(double gradient, double negligible, Concerns&& concerns, Visit&& visit) {
    std::vector<Index> stack;
    for (const Index c : roots_) {
      if (concerns(cliques_[c].columns.front())) stack.push_back(c);
    }
    while (!stack.empty()) {
      const Clique& clique = cliques_[stack.back()];
      stack.pop_back();
      if (clique.gradient <= gradient &&
          std::all_of(clique.below.begin(), clique.below.end(),
                      [&](Index v) { return z_[v].cwiseAbs().maxCoeff() <= negligible; })) {
        continue;
      }
      const Index pivots = 3 * clique.num_columns();
      make_room(clique);
      x_.leftCols(pivots) = clique.solution[for_step].y;
      for (std::size_t r = 0; r < clique.below.size(); ++r) {
        x_.template middleCols<3>(pivots + 3 * r) = z_[clique.below[r]];
      }
      rotavg::solve_upper(clique, x_);
      for (Index k = 0; k < clique.num_columns(); ++k) {
        const Index v = clique.columns[k];
        z_[v] = x_.template middleCols<3>(3 * k);
        Matrix3 Z;
        for (int r = 0; r < 3; ++r) {
          for (int c = 0; c < 3; ++c) Z(r, c) = z_[v](c, r);
        }
        visit(v, Z);
      }
      stack.insert(stack.end(), clique.children.begin(), clique.children.end());
    }
  }

 private:
  using Block = Eigen::Matrix<double, 4, 3>;

  CliqueOrder order_pending(const std::vector<Index>& last) {
    const auto size = static_cast<Index>(pending_.size());
    std::vector<std::vector<Index>> neighbours(pending_.size()), orphans;
    std::vector<bool> is_last(pending_.size(), false);
    for (Index k = 0; k < size; ++k) local_[pending_[k]] = k;
    for (const Index v : last) {
      if (local_[v] >= 0) is_last[local_[v]] = true;
    }
    for (Index k = 0; k < size; ++k) {
      system_.for_each_neighbour(pending_[k], [&](Index u) {
        if (local_[u] >= 0) neighbours[k].push_back(local_[u]);
      });
    }
    for (const Index c : orphans_) {
      orphans.emplace_back();
      for (const Index v : cliques_[c].below) orphans.back().push_back(local_[v]);
    }
    for (const Index v : pending_) local_[v] = -1;
    return ordering_(neighbours, orphans, is_last);
  }

  void make_room(const Clique& clique) {
    const Eigen::Index columns = 3 * clique.num_rows();
    if (x_.cols() < columns) x_.resize(4, 2 * columns);
  }

  void solve_lower(Clique& clique, RightHandSide side) {
    const Index columns = clique.num_columns(), pivots = 3 * columns;
    CliqueSolution& solution = clique.solution[side];
    const Index rows = 3 * clique.num_rows();
    make_room(clique);
    x_.leftCols(rows).setZero();
    clique.gradient = 0.0;
    if (side == for_bound) clique.off.setZero();
    solution.energy = 0.0;
    for (Index k = 0; k < columns; ++k) {
      const Index v = clique.columns[k];
      const Matrix3 K = system_.right_hand_side(v, side);
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) x_(c, 3 * k + r) = K(r, c);
      }
      clique.gradient = std::max(clique.gradient, system_.relative_gradient(v));
      if (side == for_bound) add(clique.off, system_.dual_is_off(v));
    }
    for (const Index c : clique.children) {
      const Clique& child = cliques_[c];
      const CliqueSolution& of_child = child.solution[side];
      for (std::size_t r = 0; r < child.in_parent.size(); ++r) {
        x_.template middleCols<3>(3 * child.in_parent[r]) +=
            of_child.left_over.template middleCols<3>(3 * r);
      }
      solution.energy += of_child.energy;
      clique.gradient = std::max(clique.gradient, child.gradient);
      if (side == for_bound) add(clique.off, child.off);
    }
    rotavg::solve_lower(clique, x_);
    solution.y = x_.leftCols(pivots);
    solution.left_over = x_.middleCols(pivots, rows - pivots);
    solution.energy += solution.y.squaredNorm();
  }

  const System& system_;
  std::vector<Block> z_, rows_;
  CliqueOrdering ordering_;
  PartialCholesky dense_;
  CliqueSolution::Rows x_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

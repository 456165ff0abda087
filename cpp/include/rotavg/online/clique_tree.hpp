#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/online/clique.hpp>
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
class CliqueTree {
 public:
  explicit CliqueTree(const System& system) : system_(system) {}

  void resize(Index num_variables) {
    clique_of_.resize(num_variables, -1);
    local_.resize(num_variables, -1);
    z_.resize(num_variables);
    is_pending_.resize(num_variables, false);
  }
  /// Whether a variable is in the tree, or waits for eliminate().
  bool holds(Index v) const { return clique_of_[v] >= 0 || is_pending_[v]; }
  const std::vector<Index>& pending() const { return pending_; }

  /// Takes the cliques from these variables up to the roots out of the tree: their variables, and
  /// those that are new, wait for eliminate().
  void detach(const std::vector<Index>& variables) {
    for (const Index v : variables) {
      if (clique_of_[v] < 0) {
        wait(v);
        continue;
      }
      for (Index c = clique_of_[v]; c >= 0;) {
        const Index parent = cliques_[c].parent;
        dissolve(c);
        c = parent;
      }
    }
  }

  /// A variable that waits does so no longer: it is no variable.
  /// @param variable none of the rows of what is in the tree
  void forget(Index variable) {
    if (!is_pending_[variable]) return;
    is_pending_[variable] = false;
    pending_.erase(std::find(pending_.begin(), pending_.end(), variable));
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

  /// Calls f(subtree, variables that it hangs from) for every subtree that waits for these.
  template <typename Function>
  void for_each_orphan(Function&& f) const {
    for (const Index c : orphans_) f(cliques_[c], cliques_[c].below);
  }

  /// Eliminates what waits.
  /// @param last which of that is to stand near the root
  /// @returns whether all pivots were positive; otherwise all still waits
  bool eliminate(const std::vector<Index>& last) {
    if (pending_.empty()) return true;
    const CliqueOrder order = order_pending(last);
    std::vector<Index> made;
    for (const CliqueOrder::Clique& of_order : order.cliques) {
      made.push_back(new_clique());
      Clique& clique = cliques_[made.back()];
      for (const Index v : of_order.columns) clique.columns.push_back(pending_[v]);
      for (const Index v : of_order.below) clique.below.push_back(pending_[v]);
    }
    for (std::size_t k = 0; k < made.size(); ++k) {
      const Index parent = order.cliques[k].parent;
      if (parent >= 0) adopt(made[parent], made[k]);
    }
    for (std::size_t k = 0; k < orphans_.size(); ++k) {
      adopt(made[order.parent_of_orphan[k]], orphans_[k]);
    }
    orphans_.clear();
    for (std::size_t k = 0; k < made.size(); ++k) {
      if (factorize(system_, cliques_, cliques_[made[k]], local_, dense_)) continue;
      for (const Index c : made) dissolve(c);
      return false;
    }
    for (const Index c : made) {
      for (const Index v : cliques_[c].columns) {
        clique_of_[v] = c;
        is_pending_[v] = false;
      }
      if (cliques_[c].parent < 0) roots_.push_back(c);
    }
    pending_.clear();
    roots_.erase(std::remove_if(roots_.begin(), roots_.end(),
                                [&](Index c) { return cliques_[c].columns.empty(); }),
                 roots_.end());
    for (const Index c : made) {
      mark(c, for_step);
      mark(c, for_bound);
    }
    return true;
  }

  /// The right-hand sides have changed at a variable.
  void mark_variable(Index v) {
    if (clique_of_[v] < 0) return;
    mark(clique_of_[v], for_step);
    mark(clique_of_[v], for_bound);
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

  /// Z = L^-T y, from the roots down; calls visit(v, Z_v), Z_v a 3 x 3 block.
  /// Left out are subtrees in which no gradient is larger than `gradient`, and which hang from
  /// variables that hardly move: no entry of Z is larger than `negligible` there.
  template <typename Visit>
  void solve_upper(double gradient, double negligible, Visit&& visit) {
    std::vector<Index> stack(roots_);
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

  /// Calls f(a variable, clique) for every root.
  template <typename Function>
  void for_each_root(Function&& f) const {
    for (const Index c : roots_) f(cliques_[c].columns.front(), cliques_[c]);
  }

 private:
  using Block = Eigen::Matrix<double, 4, 3>;

  void wait(Index v) {
    if (is_pending_[v]) return;
    is_pending_[v] = true;
    pending_.push_back(v);
  }

  Index new_clique() {
    if (free_.empty()) {
      cliques_.emplace_back();
      return static_cast<Index>(cliques_.size()) - 1;
    }
    const Index c = free_.back();
    free_.pop_back();
    return c;
  }

  void adopt(Index parent, Index child) {
    cliques_[child].parent = parent;
    cliques_[parent].children.push_back(child);
    for (const RightHandSide side : {for_step, for_bound}) {
      if (cliques_[child].solution[side].marked) ++cliques_[parent].solution[side].waiting;
    }
  }

  void dissolve(Index c) {
    Clique& clique = cliques_[c];
    for (const Index v : clique.columns) {
      clique_of_[v] = -1;
      wait(v);
    }
    if (clique.parent < 0) {
      const auto root = std::find(roots_.begin(), roots_.end(), c);
      if (root != roots_.end()) roots_.erase(root);
      const auto orphan = std::find(orphans_.begin(), orphans_.end(), c);
      if (orphan != orphans_.end()) orphans_.erase(orphan);
    } else if (!cliques_[clique.parent].columns.empty()) {
      auto& siblings = cliques_[clique.parent].children;
      siblings.erase(std::find(siblings.begin(), siblings.end(), c));
      for (const RightHandSide side : {for_step, for_bound}) {
        if (clique.solution[side].marked) --cliques_[clique.parent].solution[side].waiting;
      }
    }
    for (const Index child : clique.children) {
      cliques_[child].parent = -1;
      orphans_.push_back(child);
    }
    clique.columns.clear();
    clique.below.clear();
    clique.children.clear();
    clique.parent = -1;
    for (CliqueSolution& solution : clique.solution) {
      solution.marked = false;
      solution.waiting = 0;
    }
    free_.push_back(c);
  }

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

  void mark(Index c, RightHandSide side) {
    while (c >= 0 && !std::exchange(cliques_[c].solution[side].marked, true)) {
      marked_[side].push_back(c);
      c = cliques_[c].parent;
      if (c >= 0) ++cliques_[c].solution[side].waiting;
    }
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
  std::vector<Clique> cliques_;
  std::vector<Index> free_, roots_, orphans_, pending_;
  std::vector<Index> marked_[2];          // of every RightHandSide
  std::vector<Index> clique_of_, local_;  // of every variable
  std::vector<bool> is_pending_;
  std::vector<Block> z_;
  CliqueOrdering ordering_;
  PartialCholesky dense_;
  CliqueSolution::Rows x_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <unordered_set>
#include <utility>
#include <vector>

#include <rotavg/online/clique.hpp>
#include <rotavg/online/clique_order.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The trees of a CliqueTree: which variables are in which clique, and which wait to be eliminated;
/// which subtrees wait for these, as orphans; and where right-hand sides are to be computed anew.
class CliqueForest {
 public:
  void resize(Index num_variables) {
    clique_of_.resize(num_variables, -1);
    local_.resize(num_variables, -1);
    is_pending_.resize(num_variables, false);
  }
  /// Whether a variable is in the tree, or waits for eliminate().
  bool holds(Index v) const { return clique_of_[v] >= 0 || is_pending_[v]; }
  /// Whether a variable is in the tree, and does not wait.
  bool is_solved(Index v) const { return clique_of_[v] >= 0; }
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

  /// Calls f(subtree, variables that it hangs from) for every subtree that waits for these.
  template <typename Function>
  void for_each_orphan(Function&& f) const {
    for (const Index c : orphans_) f(cliques_[c], cliques_[c].below);
  }

  /// Calls f(a variable, clique) for every root.
  template <typename Function>
  void for_each_root(Function&& f) const {
    for (const Index c : roots_) f(cliques_[c].columns.front(), cliques_[c]);
  }

  /// The right-hand sides have changed at a variable.
  void mark_variable(Index v) {
    if (clique_of_[v] < 0) return;
    mark(clique_of_[v], for_step);
    mark(clique_of_[v], for_bound);
  }

 protected:
  /// The cliques on the ways from these variables to the roots, children before their parents.
  std::vector<Index> ways_up(const std::vector<Index>& variables) const {
    std::vector<Index> ways;
    std::unordered_set<Index> seen;
    for (auto v = variables.rbegin(); v != variables.rend(); ++v) {
      std::vector<Index> way;
      for (Index c = clique_of_[*v]; c >= 0 && seen.insert(c).second; c = cliques_[c].parent) {
        way.push_back(c);
      }
      ways.insert(ways.begin(), way.begin(), way.end());
    }
    return ways;
  }

  /// Makes cliques of what waits, in the order of `order`, and hangs the orphans from them.
  std::vector<Index> plant(const CliqueOrder& order) {
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
    return made;
  }

  /// These cliques are factorised: nothing waits any more.
  void settle(const std::vector<Index>& made) {
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
  }

  /// A clique is no more: its variables wait, and what hung from it is orphaned.
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

  std::vector<Clique> cliques_;
  std::vector<Index> roots_, orphans_, pending_;
  std::vector<Index> marked_[2];  ///< of every RightHandSide
  std::vector<Index> local_;      ///< of every variable, room to number those that wait

 private:
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

  void mark(Index c, RightHandSide side) {
    while (c >= 0 && !std::exchange(cliques_[c].solution[side].marked, true)) {
      marked_[side].push_back(c);
      c = cliques_[c].parent;
      if (c >= 0) ++cliques_[c].solution[side].waiting;
    }
  }

  std::vector<Index> free_;
  std::vector<Index> clique_of_;  ///< of every variable
  std::vector<bool> is_pending_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

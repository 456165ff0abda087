#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/linalg/block_pattern.hpp>
#include <rotavg/linalg/elimination_order.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The part of an elimination tree that is made anew: which variables are eliminated together, and
/// in which order. Variables are 0 … size - 1 here.
struct CliqueOrder {
  struct Clique {
    std::vector<Index> columns, below;
    Index parent = -1;  ///< among these cliques
  };
  std::vector<Clique> cliques;  ///< children before parents
  std::vector<Index> parent_of_orphan;
};

/// Finds it. What stands below, and stays, is given by the variables that it leaves as a clique.
///
/// Approximate minimum degree orders all but the variables that are to be last, near the root: what
/// comes next will most likely touch those, and a path from there to the root is short (the
/// constrained order of iSAM2, Kaess et al. 2012).
class CliqueOrdering {
 public:
  /// @param neighbours of every variable, both ways, perhaps several times
  /// @param orphans the variables of every subtree's clique
  /// @param is_last of every variable
  CliqueOrder operator()(const std::vector<std::vector<Index>>& neighbours,
                         const std::vector<std::vector<Index>>& orphans,
                         const std::vector<bool>& is_last) {
    size_ = static_cast<Index>(neighbours.size());
    in_orphans_.assign(size_, {});
    for (std::size_t o = 0; o < orphans.size(); ++o) {
      for (const Index v : orphans[o]) in_orphans_[v].push_back(static_cast<Index>(o));
    }
    order(neighbours, orphans, is_last);
    find_cliques(neighbours, orphans);
    amalgamate();
    return result(orphans);
  }

 private:
  struct Part {
    std::vector<Index> columns, below;  // below: positions
    Index parent = -1;
    double nonzeros = 0.0;
    bool merged = false;
  };

  void order(const std::vector<std::vector<Index>>& neighbours,
             const std::vector<std::vector<Index>>& orphans, const std::vector<bool>& is_last) {
    std::vector<Index> number(size_, -1), variable;
    for (Index v = 0; v < size_; ++v) {
      if (is_last[v]) continue;
      number[v] = static_cast<Index>(variable.size());
      variable.push_back(v);
    }
    BlockPattern pattern;
    std::vector<Index> last(variable.size(), -1), rows;
    for (std::size_t a = 0; a < variable.size(); ++a) {
      rows.clear();
      const auto add = [&](Index u) {
        const Index b = number[u];
        if (b > static_cast<Index>(a) &&
            std::exchange(last[b], static_cast<Index>(a)) != static_cast<Index>(a)) {
          rows.push_back(b);
        }
      };
      for (const Index u : neighbours[variable[a]]) add(u);
      for (const Index o : in_orphans_[variable[a]]) {
        for (const Index u : orphans[o]) add(u);
      }
      std::sort(rows.begin(), rows.end());
      pattern.row.push_back(static_cast<Index>(a));
      pattern.row.insert(pattern.row.end(), rows.begin(), rows.end());
      pattern.start.push_back(static_cast<Index>(pattern.row.size()));
    }
    variable_.clear();
    for (const Index a : approximate_minimum_degree(pattern).node) {
      variable_.push_back(variable[a]);
    }
    for (Index v = 0; v < size_; ++v) {
      if (is_last[v]) variable_.push_back(v);
    }
    position_.assign(size_, 0);
    for (Index k = 0; k < size_; ++k) position_[variable_[k]] = k;
  }

  /// Column by column: one whose rows are those of a child joins it.
  void find_cliques(const std::vector<std::vector<Index>>& neighbours,
                    const std::vector<std::vector<Index>>& orphans) {
    parts_.clear();
    clique_of_.assign(size_, -1);
    std::vector<std::vector<Index>> waiting(size_);  // cliques, at the first row below them
    std::vector<Index> seen(size_, -1), rows;
    std::vector<bool> is_counted(orphans.size(), false);
    for (Index k = 0; k < size_; ++k) {
      const Index v = variable_[k];
      rows.clear();
      const auto add = [&](Index row) {
        if (row > k && std::exchange(seen[row], k) != k) rows.push_back(row);
      };
      for (const Index u : neighbours[v]) add(position_[u]);
      for (const Index o : in_orphans_[v]) {
        if (is_counted[o]) continue;
        is_counted[o] = true;  // at its first variable
        for (const Index u : orphans[o]) add(position_[u]);
      }
      for (const Index c : waiting[k]) {
        for (const Index row : parts_[c].below) add(row);
      }
      Index own = -1;
      for (const Index c : waiting[k]) {
        if (parts_[c].below.size() == rows.size() + 1) own = c;
      }
      if (own < 0) {
        own = static_cast<Index>(parts_.size());
        parts_.emplace_back();
      }
      for (const Index c : waiting[k]) {
        if (c != own) parts_[c].parent = own;
      }
      Part& part = parts_[own];
      part.columns.push_back(v);
      part.nonzeros += 1.0 + static_cast<double>(rows.size());
      part.below = rows;
      clique_of_[k] = own;
      if (!rows.empty()) waiting[*std::min_element(rows.begin(), rows.end())].push_back(own);
    }
  }

  /// A clique joins its parent where that fills in few zeros: larger blocks are worth more than a
  /// few operations.
  void amalgamate() {
    sequence_.clear();
    for (Index k = 0; k < size_; ++k) {
      const Part& part = parts_[clique_of_[k]];
      if (part.columns.back() == variable_[k]) sequence_.push_back(clique_of_[k]);
    }
    for (const Index c : sequence_) {
      Part& child = parts_[c];
      if (child.parent < 0) continue;
      Part& parent = parts_[child.parent];
      const auto columns = static_cast<double>(child.columns.size() + parent.columns.size());
      const double entries =
          columns * (columns + 1.0) / 2.0 + columns * static_cast<double>(parent.below.size());
      const double zeros = 1.0 - (child.nonzeros + parent.nonzeros) / entries;
      if (zeros > (columns <= 4 ? 0.5 : columns <= 16 ? 0.15 : 0.05)) continue;
      parent.nonzeros += child.nonzeros;
      parent.columns.insert(parent.columns.begin(), child.columns.begin(), child.columns.end());
      child.merged = true;
    }
  }

  CliqueOrder result(const std::vector<std::vector<Index>>& orphans) {
    const auto root_of = [&](Index c) {
      while (parts_[c].merged) c = parts_[c].parent;
      return c;
    };
    CliqueOrder result;
    std::vector<Index> number(parts_.size(), -1);
    for (const Index c : sequence_) {
      if (parts_[c].merged) continue;
      number[c] = static_cast<Index>(result.cliques.size());
      CliqueOrder::Clique clique;
      clique.columns = std::move(parts_[c].columns);
      std::sort(parts_[c].below.begin(), parts_[c].below.end());
      for (const Index row : parts_[c].below) clique.below.push_back(variable_[row]);
      clique.parent = parts_[c].parent;
      result.cliques.push_back(std::move(clique));
    }
    for (CliqueOrder::Clique& clique : result.cliques) {
      if (clique.parent >= 0) clique.parent = number[root_of(clique.parent)];
    }
    for (const std::vector<Index>& orphan : orphans) {
      Index first = size_;
      for (const Index v : orphan) first = std::min(first, position_[v]);
      result.parent_of_orphan.push_back(first == size_ ? -1 : number[root_of(clique_of_[first])]);
    }
    return result;
  }

  Index size_ = 0;
  std::vector<std::vector<Index>> in_orphans_;
  std::vector<Index> variable_, position_;  // of every position; of every variable
  std::vector<Part> parts_;
  std::vector<Index> clique_of_;  // of every position
  std::vector<Index> sequence_;   // of the cliques, children first
};

}  // namespace rotavg

#pragma GCC diagnostic pop

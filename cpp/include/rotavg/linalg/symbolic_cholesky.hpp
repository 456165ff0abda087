#pragma once

#include <algorithm>
#include <cstddef>
#include <new>
#include <stdexcept>
#include <utility>
#include <vector>

#include <amd.h>

#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Where a symmetric matrix of blocks has entries: its lower triangle by columns, in compressed
/// form. The rows of a column rise, and the first is the diagonal.
struct BlockPattern {
  std::vector<Index> start = {0};  ///< (n + 1,) where each column begins in `row`
  std::vector<Index> row;

  Index size() const { return static_cast<Index>(start.size()) - 1; }
};

/// An order of elimination that keeps the Cholesky factor sparse.
struct EliminationOrder {
  std::vector<Index> node;  ///< (n,) the node that is eliminated k-th
  /// Multiplications that a factorisation in this order takes at most, divisions and roots
  /// included, with blocks of size one; for blocks of size B about B^3 times as many.
  double multiplications = 0.0;
  double nonzeros = 0.0;  ///< of the factor below the diagonal, about, with blocks of size one
};

/// Approximate minimum degree (Amestoy, Davis and Duff 2004), by SuiteSparse's AMD.
/// @throws std::bad_alloc
inline EliminationOrder approximate_minimum_degree(const BlockPattern& pattern) {
  EliminationOrder order;
  if (pattern.size() == 0) return order;  // amd_order takes no null pointers
  order.node.resize(static_cast<std::size_t>(pattern.size()));
  double control[AMD_CONTROL], info[AMD_INFO];
  amd_defaults(control);
  const int status = amd_order(pattern.size(), pattern.start.data(), pattern.row.data(),
                               order.node.data(), control, info);
  if (status == AMD_OUT_OF_MEMORY) throw std::bad_alloc();
  if (status < 0) throw std::logic_error("the pattern is not that of a symmetric matrix");
  order.multiplications = info[AMD_NMULTSUBS_LDL] + info[AMD_LNZ] + pattern.size();
  order.nonzeros = info[AMD_LNZ];
  return order;
}

/// What a Cholesky factorisation needs to know of a pattern: the elimination tree (Liu 1990), cut
/// into supernodes, which are neighbouring columns of L with (nearly) the same rows. It does not
/// depend on the size of the blocks, so one analysis of a graph serves its scalar Laplacian and all
/// its matrices of 3 x 3 blocks.
///
/// Columns are counted in the order of elimination: column k is that of node order.node[k].
class SymbolicCholesky {
 public:
  struct Supernode {
    Index begin = 0, end = 0;      ///< columns
    Index parent = -1;             ///< supernode, -1 for a root
    Index first = 0;               ///< supernode: with it begins the subtree that ends here
    std::vector<Index> below;      ///< further rows, rising
    std::vector<Index> in_parent;  ///< where these stand among the parent's rows

    Index columns() const { return end - begin; }
    Index num_below() const { return static_cast<Index>(below.size()); }
    std::size_t rows() const { return below.size() + (end - begin); }
    /// Multiplications of its elimination, about, with blocks of size one.
    double work() const {
      const double pivots = columns(), others = num_below();
      return pivots * (pivots * pivots / 6.0 + 0.5 * (pivots + others) * (others + 1.0));
    }
  };
  /// An entry of the pattern in the column where it is eliminated.
  struct Entry {
    Index index;      ///< in pattern.row
    Index place;      ///< of its row among the rows of the supernode; not above the column
    bool transposed;  ///< whether the pattern holds it as the block (column, row)
  };

  SymbolicCholesky(const BlockPattern& pattern, EliminationOrder order)
      : node_(std::move(order.node)) {
    // Postordered, each subtree of the elimination tree is a range of columns.
    sort_entries(pattern);
    find_parents();
    reorder(postorder(parent_));
    sort_entries(pattern);
    find_parents();
    find_supernodes();
    find_rows();
    if (root_in_the_middle()) {
      sort_entries(pattern);
      find_rows();
    }
  }

  Index size() const { return static_cast<Index>(node_.size()); }
  /// (n,) the node of each column.
  const std::vector<Index>& node() const { return node_; }
  const std::vector<Supernode>& supernodes() const { return supernodes_; }
  /// Calls f with the children of supernode s, the last first.
  template <typename Function>
  void for_each_child(Index s, Function&& f) const {
    for (Index c = s - 1; c >= supernodes_[s].first; c = supernodes_[c].first - 1) f(c);
  }
  const Entry* entries_begin(Index column) const { return entries_.data() + start_[column]; }
  const Entry* entries_end(Index column) const { return entries_.data() + start_[column + 1]; }

 private:
  void reorder(const std::vector<Index>& columns) {
    std::vector<Index> node;
    node.reserve(node_.size());
    for (const Index k : columns) node.push_back(node_[k]);
    node_ = std::move(node);
  }

  /// Sorts the entries into their columns. (Entry::place is the row itself until find_rows.)
  void sort_entries(const BlockPattern& pattern) {
    const Index n = size();
    std::vector<Index> column_of(static_cast<std::size_t>(n));
    for (Index k = 0; k < n; ++k) column_of[node_[k]] = k;
    start_.assign(static_cast<std::size_t>(n) + 1, 0);
    rows_start_ = start_;
    const auto for_each_entry = [&](auto&& f) {
      for (Index j = 0; j < n; ++j) {
        for (Index e = pattern.start[j]; e < pattern.start[j + 1]; ++e) {
          const Index a = column_of[pattern.row[e]], b = column_of[j];
          f(Entry{e, std::max(a, b), a < b}, std::min(a, b));
        }
      }
    };
    for_each_entry([&](const Entry& entry, Index column) {
      ++start_[column + 1];
      ++rows_start_[entry.place + 1];
    });
    for (Index k = 0; k < n; ++k) {
      start_[k + 1] += start_[k];
      rows_start_[k + 1] += rows_start_[k];
    }
    entries_.resize(pattern.row.size());
    rows_.resize(pattern.row.size());
    std::vector<Index> next(start_.begin(), start_.end() - 1);
    std::vector<Index> next_in_row(rows_start_.begin(), rows_start_.end() - 1);
    for_each_entry([&](const Entry& entry, Index column) {
      entries_[next[column]++] = entry;
      rows_[next_in_row[entry.place]++] = column;
    });
  }

  /// The parent of every column: the first row below the diagonal in its column of L.
  void find_parents() {
    parent_.assign(node_.size(), -1);
    std::vector<Index> ancestor(parent_);
    for (Index k = 0; k < size(); ++k) {
      for (Index e = rows_start_[k]; e < rows_start_[k + 1]; ++e) {
        for (Index i = rows_[e]; i != -1 && i < k;) {
          const Index up = std::exchange(ancestor[i], k);
          if (up == -1) parent_[i] = k;
          i = up;
        }
      }
    }
  }

  /// Children before parents, subtree by subtree.
  static std::vector<Index> postorder(const std::vector<Index>& parent) {
    const auto n = static_cast<Index>(parent.size());
    std::vector<Index> first_child(static_cast<std::size_t>(n), -1), sibling(first_child);
    for (Index k = n - 1; k >= 0; --k) {
      if (parent[k] >= 0) sibling[k] = std::exchange(first_child[parent[k]], k);
    }
    std::vector<Index> order, stack;
    order.reserve(static_cast<std::size_t>(n));
    for (Index root = 0; root < n; ++root) {
      if (parent[root] >= 0) continue;
      stack.push_back(root);
      while (!stack.empty()) {
        const Index k = stack.back();
        if (first_child[k] >= 0) {
          stack.push_back(std::exchange(first_child[k], -1));
          continue;
        }
        stack.pop_back();
        order.push_back(k);
        if (sibling[k] >= 0) stack.push_back(sibling[k]);
      }
    }
    return order;
  }

  /// Number of rows below the diagonal in every column of L: column i has row k if it lies on a
  /// path of the tree from an entry of row k up to k.
  std::vector<Index> column_counts() const {
    const Index n = size();
    std::vector<Index> count(static_cast<std::size_t>(n), 0), visited(count);
    for (Index k = 0; k < n; ++k) {
      visited[k] = k;
      for (Index e = rows_start_[k]; e < rows_start_[k + 1]; ++e) {
        for (Index i = rows_[e]; visited[i] != k; i = parent_[i]) {
          ++count[i];
          visited[i] = k;
        }
      }
    }
    return count;
  }

  /// Columns that share their rows become a supernode; then a supernode joins its parent where that
  /// fills in few zeros, as larger blocks are worth more than a few operations.
  void find_supernodes() {
    const std::vector<Index> count = column_counts();
    struct Block {
      Index begin, end, below;
      double nonzeros;
    };
    const auto entries = [](double columns, double below) {
      return columns * (columns + 1.0) / 2.0 + columns * below;
    };
    std::vector<Block> blocks;
    for (Index begin = 0; begin < size();) {
      Index end = begin + 1;
      while (end < size() && parent_[end - 1] == end && count[end - 1] == count[end] + 1) ++end;
      Block block{begin, end, count[end - 1], entries(end - begin, count[end - 1])};
      begin = end;
      // Its last child stands just before it.
      while (!blocks.empty()) {
        const Block& child = blocks.back();
        const Index parent = parent_[child.end - 1];
        if (parent < block.begin || parent >= block.end) break;
        const double columns = block.end - child.begin;
        const double nonzeros = child.nonzeros + block.nonzeros;
        const double zeros = 1.0 - nonzeros / entries(columns, block.below);
        const double allowed = columns <= 4 ? 0.5 : columns <= 16 ? 0.15 : 0.05;
        if (zeros > allowed) break;
        block.begin = child.begin;
        block.nonzeros = nonzeros;
        blocks.pop_back();
      }
      blocks.push_back(block);
    }
    supernodes_.assign(blocks.size(), {});
    for (std::size_t s = 0; s < blocks.size(); ++s) {
      supernodes_[s].begin = blocks[s].begin;
      supernodes_[s].end = blocks[s].end;
    }
  }

  /// Roots the tree of supernodes where no path from a leaf holds more of the work than it must.
  /// The rows of a supernode are a clique of the graph that L fills in, and this tree one of
  /// cliques; any of them may be its root, and L is as full (Liu 1988): of a long band, where the
  /// tree is a path, the one in the middle leaves two halves that do not depend on each other. On
  /// the way from the new root to the old one parents become children, and each clique keeps as
  /// columns what it does not share with its new parent.
  /// @returns whether anything has changed; then entries and rows are to be found anew
  bool root_in_the_middle() {
    constexpr double worthwhile = 0.25, much = 1e5;  // for several threads to share
    const auto num_supernodes = static_cast<Index>(supernodes_.size());
    std::vector<double> work(supernodes_.size(), 0.0);  // of subtrees
    for (Index s = 0; s < num_supernodes; ++s) {
      work[s] += supernodes_[s].work();
      if (supernodes_[s].parent >= 0) work[supernodes_[s].parent] += work[s];
    }
    std::vector<std::vector<Index>> paths;  // from old roots to new ones
    std::vector<bool> on_path(supernodes_.size(), false);
    for (Index root = 0; root < num_supernodes; ++root) {
      if (supernodes_[root].parent >= 0 || work[root] < much) continue;
      std::vector<Index> path;
      for (Index s = root, heaviest = root; heaviest >= 0; s = heaviest) {
        path.push_back(s);
        heaviest = -1;
        for_each_child(s, [&](Index c) {
          if (work[c] >= 0.5 * work[root]) heaviest = c;
        });
      }
      if (work[root] - work[path.back()] < worthwhile * work[root]) continue;
      for (const Index s : path) on_path[s] = true;
      paths.push_back(std::move(path));
    }
    if (paths.empty()) return false;

    struct Clique {
      std::vector<Index> columns, below;
    };
    std::vector<Clique> cliques;  // an order in which they can be eliminated
    for (Index s = 0; s < num_supernodes; ++s) {
      if (on_path[s]) continue;
      cliques.push_back({{}, supernodes_[s].below});
      for (Index k = supernodes_[s].begin; k < supernodes_[s].end; ++k) {
        cliques.back().columns.push_back(k);
      }
    }
    std::vector<Index> last_clique(node_.size(), -1);  // on a path, that has a column
    for (const std::vector<Index>& path : paths) {
      const auto for_each_row = [&](Index s, auto&& f) {
        for (Index k = supernodes_[s].begin; k < supernodes_[s].end; ++k) f(k);
        for (const Index row : supernodes_[s].below) f(row);
      };
      for (std::size_t k = 0; k < path.size(); ++k) {
        Clique clique;
        const Index next = k + 1 < path.size() ? path[k + 1] : -1;
        if (next >= 0) for_each_row(next, [&](Index row) { last_clique[row] = next; });
        for_each_row(path[k], [&](Index row) {
          const bool shared = next >= 0 && last_clique[row] == next;
          (shared ? clique.below : clique.columns).push_back(row);
        });
        if (!clique.columns.empty()) cliques.push_back(std::move(clique));
      }
    }

    // The parent of a clique has the first of its rows below; numbers twice, for postorder.
    std::vector<Index> number(node_.size()), clique_of(node_.size()), order(cliques.size());
    std::vector<Index> parent(cliques.size(), -1);
    for (std::size_t c = 0; c < order.size(); ++c) order[c] = static_cast<Index>(c);
    const auto renumber = [&] {
      Index next = 0;
      for (const Index c : order) {
        for (const Index column : cliques[c].columns) {
          number[column] = next++;
          clique_of[column] = c;
        }
      }
    };
    renumber();
    for (const Index c : order) {
      const auto& below = cliques[c].below;
      const auto first = std::min_element(below.begin(), below.end(),
                                          [&](Index a, Index b) { return number[a] < number[b]; });
      if (first != below.end()) parent[c] = clique_of[*first];
    }
    order = postorder(parent);
    renumber();
    std::vector<Index> columns;
    supernodes_.clear();
    for (const Index c : order) {
      Supernode node;
      node.begin = static_cast<Index>(columns.size());
      columns.insert(columns.end(), cliques[c].columns.begin(), cliques[c].columns.end());
      node.end = static_cast<Index>(columns.size());
      for (const Index row : cliques[c].below) node.below.push_back(number[row]);
      supernodes_.push_back(std::move(node));
    }
    reorder(columns);
    return true;
  }

  /// The rows of a supernode: those of its entries and those of its children.
  void find_rows() {
    std::vector<Index> supernode_of(static_cast<std::size_t>(size())), place(supernode_of);
    const auto num_supernodes = static_cast<Index>(supernodes_.size());
    for (Index s = 0; s < num_supernodes; ++s) {
      for (Index k = supernodes_[s].begin; k < supernodes_[s].end; ++k) supernode_of[k] = s;
    }
    std::vector<Index> visited(place.size(), -1);
    for (Index s = 0; s < num_supernodes; ++s) {
      Supernode& node = supernodes_[s];
      // In postorder the subtrees of its children stand before it, the last child's last.
      node.first = s;
      while (node.first > 0 && supernodes_[node.first - 1].parent == s) {
        node.first = supernodes_[node.first - 1].first;
      }
      for (const Index row : node.below) visited[row] = s;  // known already
      const auto add = [&](Index row) {
        if (row >= node.end && std::exchange(visited[row], s) != s) node.below.push_back(row);
      };
      const Entry* const begin = entries_begin(node.begin);
      for (const Entry* e = begin; e != entries_end(node.end - 1); ++e) add(e->place);
      for_each_child(s, [&](Index child) {
        for (const Index row : supernodes_[child].below) add(row);
      });
      std::sort(node.below.begin(), node.below.end());
      if (!node.below.empty()) node.parent = supernode_of[node.below.front()];

      Index next = 0;
      for (Index k = node.begin; k < node.end; ++k) place[k] = next++;
      for (const Index row : node.below) place[row] = next++;
      for (Index e = start_[node.begin]; e < start_[node.end]; ++e) {
        entries_[e].place = place[entries_[e].place];
      }
      for_each_child(s, [&](Index child) {
        for (const Index row : supernodes_[child].below) {
          supernodes_[child].in_parent.push_back(place[row]);
        }
      });
    }
  }

  std::vector<Index> node_;
  std::vector<Index> parent_;  // of columns
  std::vector<Index> start_;
  std::vector<Entry> entries_;
  std::vector<Index> rows_start_, rows_;  // columns of the entries of each row
  std::vector<Supernode> supernodes_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/linalg/block_pattern.hpp>
#include <rotavg/linalg/elimination_order.hpp>
#include <rotavg/linalg/middle_root.hpp>
#include <rotavg/linalg/supernodes.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What a Cholesky factorisation needs to know of a pattern: the elimination tree (Liu 1990), cut
/// into supernodes, which are neighbouring columns of L with (nearly) the same rows. It does not
/// depend on the size of the blocks, so one analysis of a graph serves its scalar Laplacian and all
/// its matrices of 3 x 3 blocks.
///
/// Columns are counted in the order of elimination: column k is that of node order.node[k].
class SymbolicCholesky {
 public:
  using Supernode = rotavg::Supernode;
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
    if (auto other = rooted_in_the_middle(supernodes_)) {
      supernodes_ = std::move(other->supernodes);
      reorder(other->columns);
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
    rotavg::for_each_child(supernodes_, s, f);
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
      supernodes_[s].below.reserve(static_cast<std::size_t>(blocks[s].below));
    }
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
        supernodes_[child].in_parent.reserve(supernodes_[child].below.size());
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

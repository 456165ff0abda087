#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/linalg/supernodes.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Supernodes with rows, but without parents and places, and in which order they take the columns.
struct OtherRoot {
  std::vector<Index> columns;
  std::vector<Supernode> supernodes;
};

/// Roots the tree of supernodes where no path from a leaf holds more of the work than it must.
/// The rows of a supernode are a clique of the graph that L fills in, and this tree one of
/// cliques; any of them may be its root, and L is as full (Liu 1988): of a long band, where the
/// tree is a path, the one in the middle leaves two halves that do not depend on each other. On
/// the way from the new root to the old one parents become children, and each clique keeps as
/// columns what it does not share with its new parent.
/// @param supernodes in postorder, with parents and rows
/// @returns nothing where the root stays
inline std::optional<OtherRoot> rooted_in_the_middle(const std::vector<Supernode>& supernodes) {
  constexpr double worthwhile = 0.25, much = 1e7;  // for several threads to share
  const auto num_supernodes = static_cast<Index>(supernodes.size());
  const auto num_columns = static_cast<std::size_t>(supernodes.empty() ? 0 : supernodes.back().end);
  std::vector<double> work(supernodes.size(), 0.0);  // of subtrees
  for (Index s = 0; s < num_supernodes; ++s) {
    work[s] += supernodes[s].work();
    if (supernodes[s].parent >= 0) work[supernodes[s].parent] += work[s];
  }
  std::vector<std::vector<Index>> paths;  // from old roots to new ones
  std::vector<bool> on_path(supernodes.size(), false);
  for (Index root = 0; root < num_supernodes; ++root) {
    if (supernodes[root].parent >= 0 || work[root] < much) continue;
    std::vector<Index> path;
    for (Index s = root, heaviest = root; heaviest >= 0; s = heaviest) {
      path.push_back(s);
      heaviest = -1;
      for_each_child(supernodes, s, [&](Index c) {
        if (work[c] >= 0.5 * work[root]) heaviest = c;
      });
    }
    if (work[root] - work[path.back()] < worthwhile * work[root]) continue;
    for (const Index s : path) on_path[s] = true;
    paths.push_back(std::move(path));
  }
  if (paths.empty()) return std::nullopt;

  struct Bag {
    std::vector<Index> columns, below;
  };
  std::vector<Bag> cliques;  // an order in which they can be eliminated
  for (Index s = 0; s < num_supernodes; ++s) {
    if (on_path[s]) continue;
    cliques.push_back({{}, supernodes[s].below});
    for (Index k = supernodes[s].begin; k < supernodes[s].end; ++k) {
      cliques.back().columns.push_back(k);
    }
  }
  std::vector<Index> last_clique(num_columns, -1);  // on a path, that has a column
  for (const std::vector<Index>& path : paths) {
    const auto for_each_row = [&](Index s, auto&& f) {
      for (Index k = supernodes[s].begin; k < supernodes[s].end; ++k) f(k);
      for (const Index row : supernodes[s].below) f(row);
    };
    for (std::size_t k = 0; k < path.size(); ++k) {
      Bag clique;
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
  std::vector<Index> number(num_columns), clique_of(num_columns), order(cliques.size());
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
  OtherRoot result;
  for (const Index c : order) {
    Supernode node;
    node.begin = static_cast<Index>(result.columns.size());
    result.columns.insert(result.columns.end(), cliques[c].columns.begin(),
                          cliques[c].columns.end());
    node.end = static_cast<Index>(result.columns.size());
    for (const Index row : cliques[c].below) node.below.push_back(number[row]);
    result.supernodes.push_back(std::move(node));
  }
  return result;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

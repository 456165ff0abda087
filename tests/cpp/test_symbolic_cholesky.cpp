#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/linalg/eigen_minimum_degree.hpp>
#include <rotavg/linalg/subtrees.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>

#include "support/blocks.hpp"
#include "support/graphs.hpp"
#include "support/patterns.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::numbers;
using rotavg::test::pattern_of;
using rotavg::test::Random;
using rotavg::test::random_order;

namespace {

double entries_of(const SymbolicCholesky::Supernode& node) {
  return 0.5 * node.columns() * (node.columns() + 1.0) + 1.0 * node.columns() * node.num_below();
}

const SymbolicCholesky::Supernode& supernode_of(const SymbolicCholesky& symbolic, Index column) {
  const auto& all = symbolic.supernodes();
  return *std::find_if(all.begin(), all.end(), [&](const auto& s) { return column < s.end; });
}

Index row_at(const SymbolicCholesky::Supernode& node, Index place) {
  return place < node.columns() ? node.begin + place : node.below[place - node.columns()];
}

void check_analysis(const BlockPattern& pattern, const EliminationOrder& order) {
  const SymbolicCholesky symbolic(pattern, order);
  const Index n = pattern.size();
  REQUIRE(symbolic.size() == n);

  std::vector<Index> sorted = symbolic.node();
  std::sort(sorted.begin(), sorted.end());
  REQUIRE(sorted == numbers(n));

  // Postorder changes neither the fill nor the tree, but makes each subtree a range of columns.
  const auto rows = test::rows_of_factor(pattern, symbolic.node());
  REQUIRE(test::multiplications_of(rows) ==
          test::multiplications_of(test::rows_of_factor(pattern, order.node)));
  std::vector<Index> first_descendant = numbers(n), descendants(sorted.size(), 0);
  for (Index k = 0; k < n; ++k) {
    REQUIRE(k - first_descendant[k] == descendants[k]);
    if (rows[k].empty()) continue;
    const Index parent = rows[k].front();
    first_descendant[parent] = std::min(first_descendant[parent], first_descendant[k]);
    descendants[parent] += 1 + descendants[k];
  }

  // Every entry once, in the lower triangle.
  std::vector<int> seen(pattern.row.size(), 0);
  for (Index k = 0; k < n; ++k) {
    for (auto e = symbolic.entries_begin(k); e != symbolic.entries_end(k); ++e) {
      ++seen[e->index];
      const Index row_of_factor = row_at(supernode_of(symbolic, k), e->place);
      REQUIRE(row_of_factor >= k);
      if (row_of_factor == k) REQUIRE(!e->transposed);
      const Index row = pattern.row[e->index];
      const auto next = std::upper_bound(pattern.start.begin(), pattern.start.end(), e->index);
      const auto column = static_cast<Index>(next - pattern.start.begin()) - 1;
      REQUIRE(symbolic.node()[row_of_factor] == (e->transposed ? column : row));
      REQUIRE(symbolic.node()[k] == (e->transposed ? row : column));
    }
  }
  REQUIRE(std::all_of(seen.begin(), seen.end(), [](int times) { return times == 1; }));

  // Supernodes are ranges of columns whose rows are those of L, but for few zeros.
  Index begin = 0;
  for (std::size_t s = 0; s < symbolic.supernodes().size(); ++s) {
    const auto& node = symbolic.supernodes()[s];
    REQUIRE(node.begin == begin);
    REQUIRE(node.end > node.begin);
    begin = node.end;
    REQUIRE(node.below == rows[node.end - 1]);
    double nonzeros = 0.0;
    for (Index k = node.begin; k < node.end; ++k) {
      if (k + 1 < node.end) REQUIRE((!rows[k].empty() && rows[k].front() < node.end));
      nonzeros += 1.0 + static_cast<double>(rows[k].size());
      for (const Index row : rows[k]) {
        REQUIRE((row < node.end || std::binary_search(node.below.begin(), node.below.end(), row)));
      }
    }
    REQUIRE(nonzeros >= entries_of(node) * (node.columns() <= 4 ? 0.5 : 0.85));
    if (node.below.empty()) {
      REQUIRE(node.parent == -1);
      continue;
    }
    REQUIRE(node.parent > static_cast<Index>(s));
    const auto& parent = symbolic.supernodes()[node.parent];
    REQUIRE(parent.begin <= node.below.front());
    REQUIRE(parent.end > node.below.front());
    REQUIRE(node.in_parent.size() == node.below.size());
    for (std::size_t r = 0; r < node.below.size(); ++r) {
      REQUIRE(row_at(parent, node.in_parent[r]) == node.below[r]);
    }
  }
  // A subtree is a range of supernodes, and the children are those that name their parent.
  for (Index s = 0; s < static_cast<Index>(symbolic.supernodes().size()); ++s) {
    std::vector<Index> children, found;
    for (Index c = s - 1; c >= 0; --c) {
      if (symbolic.supernodes()[c].parent == s) children.push_back(c);
    }
    symbolic.for_each_child(s, [&](Index c) { found.push_back(c); });
    REQUIRE(found == children);
    const Index first = symbolic.supernodes()[s].first;
    REQUIRE(first == (children.empty() ? s : symbolic.supernodes()[children.back()].first));
  }
  REQUIRE(begin == n);
}

}  // namespace

TEST_CASE("the analysis of a graph is that of elimination column by column, in any order") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 300; ++k) {
    const Index n = 1 + random.below(40);
    const bool connected = random.coin();
    test::Pairs pairs;
    if (connected && n > 1) {
      pairs = test::random_connected(random, n, random.below(n));
    } else {
      for (Index e = random.below(2 * n); e > 0; --e) {
        const Index i = random.below(n), j = random.below(n);
        if (i != j) pairs.emplace_back(i, j);
      }
    }
    const BlockPattern pattern = pattern_of(n, pairs);
    CAPTURE(k);
    CAPTURE(n);
    check_analysis(pattern, approximate_minimum_degree(pattern));
    check_analysis(pattern, eigen_minimum_degree(pattern));
    check_analysis(pattern, EliminationOrder{numbers(n)});
    check_analysis(pattern, random_order(random, n));
  }
}

TEST_CASE("so is that of paths, stars, grids and complete graphs") {
  Random random;
  INFO(random.replay());
  test::Pairs star;
  for (Index i = 1; i < 50; ++i) star.emplace_back(0, i);
  for (const test::Pairs& pairs :
       {test::path(100), test::cycle(60), star, test::grid(9, 11), test::complete(40)}) {
    const BlockPattern pattern = pattern_of(test::num_nodes(pairs), pairs);
    check_analysis(pattern, approximate_minimum_degree(pattern));
    check_analysis(pattern, random_order(random, pattern.size()));
  }
}

TEST_CASE("the supernode of a complete graph is one, and so are those of long paths few") {
  const BlockPattern complete = pattern_of(30, test::complete(30));
  const SymbolicCholesky dense(complete, approximate_minimum_degree(complete));
  REQUIRE(dense.supernodes().size() == 1);
  CHECK(dense.supernodes()[0].columns() == 30);
  const BlockPattern path = pattern_of(1000, test::path(1000));
  CHECK(SymbolicCholesky(path, approximate_minimum_degree(path)).supernodes().size() < 500);
}

TEST_CASE("a long band has a root in its middle, and two halves for two threads") {
  BlockPattern pattern;
  for (Index i = 0; i < 3000; ++i) {
    for (Index d = 0; d <= 90 && i + d < 3000; ++d) pattern.row.push_back(i + d);
    pattern.start.push_back(static_cast<Index>(pattern.row.size()));
  }
  for (const EliminationOrder& order :
       {EliminationOrder{numbers(3000)}, approximate_minimum_degree(pattern)}) {
    const SymbolicCholesky symbolic(pattern, order);
    const Subtrees halves(symbolic, 3, 2), whole(symbolic, 3, 1);
    CHECK(whole.ranges().size() == 1);
    CHECK(whole.above().empty());
    double inside = 0.0;
    for (const auto& range : halves.ranges()) {
      CHECK(range.work <= 0.55 * halves.work());
      inside += range.work;
    }
    CHECK(inside >= 0.9 * halves.work());
  }
}

TEST_CASE("whichever root it has, a tree holds all rows of L, and takes no more work") {
  Random random;
  INFO(random.replay());
  for (const Index width : {110, 130}) {
    const Index n = 1600;
    BlockPattern pattern;
    for (Index i = 0; i < n; ++i) {
      pattern.row.push_back(i);
      for (Index d = 1; d <= width && i + d < n; ++d) {
        if (d == 1 || random.coin()) pattern.row.push_back(i + d);
      }
      pattern.start.push_back(static_cast<Index>(pattern.row.size()));
    }
    const EliminationOrder given{numbers(n)};
    const SymbolicCholesky symbolic(pattern, given);
    CHECK(symbolic.node() != given.node);
    const auto rows = test::rows_of_factor(pattern, symbolic.node());
    double work = 0.0;
    Index begin = 0;
    for (const auto& node : symbolic.supernodes()) {
      REQUIRE(node.begin == begin);
      begin = node.end;
      work += node.work();
      for (Index k = node.begin; k < node.end; ++k) {
        for (const Index row : rows[k]) {
          REQUIRE(
              (row < node.end || std::binary_search(node.below.begin(), node.below.end(), row)));
        }
      }
      if (node.below.empty()) continue;
      REQUIRE(node.in_parent.size() == node.below.size());
      for (std::size_t r = 0; r < node.below.size(); ++r) {
        REQUIRE(row_at(symbolic.supernodes()[node.parent], node.in_parent[r]) == node.below[r]);
      }
    }
    REQUIRE(begin == n);
    CHECK(work <= 1.35 * test::multiplications_of(test::rows_of_factor(pattern, given.node)));
  }
}

TEST_CASE("ranges of subtrees and what is above them are all supernodes, once") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Index n = 1 + random.below(300);
    const auto pairs =
        n > 1 ? test::random_connected(random, n, random.below(2 * n)) : test::Pairs{};
    const BlockPattern pattern = pattern_of(n, pairs);
    const SymbolicCholesky symbolic(pattern, random_order(random, n));
    const auto& supernodes = symbolic.supernodes();
    for (const int num_threads : {1, 2, 8, 1000}) {
      const Subtrees subtrees(symbolic, 30, num_threads);  // much work, so that it is cut
      std::vector<int> seen(supernodes.size(), 0);
      for (const auto& range : subtrees.ranges()) {
        for (Index s = range.begin; s < range.end; ++s) {
          ++seen[s];
          REQUIRE(supernodes[s].first >= range.begin);  // with all its descendants
        }
      }
      for (const Index s : subtrees.above()) ++seen[s];
      REQUIRE(seen == std::vector<int>(supernodes.size(), 1));
      REQUIRE(std::is_sorted(subtrees.above().begin(), subtrees.above().end()));
    }
  }
}

TEST_CASE("an empty pattern has an empty order and no supernodes") {
  const EliminationOrder order = approximate_minimum_degree({});
  CHECK(order.node.empty());
  CHECK(order.multiplications == 0.0);
  const SymbolicCholesky symbolic(BlockPattern{}, order);
  CHECK(symbolic.size() == 0);
  CHECK(symbolic.supernodes().empty());
}

TEST_CASE("what is no pattern of a symmetric matrix is refused") {
  BlockPattern pattern;
  pattern.start = {0, 1};
  pattern.row = {1};  // beyond the last row
  CHECK_THROWS_AS(approximate_minimum_degree(pattern), std::logic_error);
}

TEST_CASE("long paths and deep trees do not exhaust the stack") {
  constexpr Index n = 200000;
  BlockPattern pattern;
  for (Index i = 0; i < n; ++i) {
    pattern.row.push_back(i);
    if (i + 1 < n) pattern.row.push_back(i + 1);
    pattern.start.push_back(static_cast<Index>(pattern.row.size()));
  }
  // In this order the elimination tree is one long chain.
  const SymbolicCholesky symbolic(pattern, EliminationOrder{numbers(n)});
  CHECK(symbolic.size() == n);
  std::vector<Index> sorted = symbolic.node();
  std::sort(sorted.begin(), sorted.end());
  CHECK(sorted == numbers(n));
}

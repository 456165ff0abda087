#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/linalg/eigen_minimum_degree.hpp>
#include <rotavg/linalg/elimination_order.hpp>

#include "support/graphs.hpp"
#include "support/patterns.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::multiplications_of;
using rotavg::test::numbers;
using rotavg::test::pattern_of;
using rotavg::test::Random;
using rotavg::test::random_order;
using rotavg::test::rows_of_factor;

TEST_CASE("the multiplications of an order are those of its elimination, or a few more") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Index n = 2 + random.below(60);
    const auto pairs = test::random_connected(random, n, random.below(2 * n));
    const BlockPattern pattern = pattern_of(n, pairs);
    const EliminationOrder order = approximate_minimum_degree(pattern);
    const double exact = multiplications_of(rows_of_factor(pattern, order.node));
    CAPTURE(n);
    REQUIRE(order.multiplications >= exact);
    REQUIRE(order.multiplications <= 1.5 * exact);
  }
  for (const Index n : {1, 2, 3, 10, 100}) {
    const double expected = n * (n + 1.0) * (n + 2.0) / 6.0;
    CHECK(approximate_minimum_degree(pattern_of(n, test::complete(n))).multiplications == expected);
    CHECK(approximate_minimum_degree(pattern_of(n, {})).multiplications == n);
    CHECK(approximate_minimum_degree(pattern_of(n, test::path(n))).multiplications ==
          3.0 * n - 2.0);
  }
}

TEST_CASE("the nodes' own order is bounded by its envelope, and taken where that is less work") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Index n = 2 + random.below(60);
    const BlockPattern pattern =
        pattern_of(n, test::random_connected(random, n, random.below(2 * n)));
    const EliminationOrder order = natural_order(pattern);
    CAPTURE(n);
    REQUIRE(order.node == numbers(n));
    const auto rows = rows_of_factor(pattern, order.node);
    double nonzeros = 0.0;
    for (const auto& below : rows) nonzeros += static_cast<double>(below.size());
    REQUIRE(order.multiplications >= multiplications_of(rows));
    REQUIRE(order.nonzeros >= nonzeros);
    const double by_degree = approximate_minimum_degree(pattern).multiplications;
    REQUIRE(elimination_order(pattern).multiplications ==
            std::min(by_degree, order.multiplications));
  }
  // A video: each frame joined to the next, and to nine of the sixty behind it.
  test::Pairs pairs = test::path(2000);
  for (Index i = 0; i + 61 < 2000; ++i) {
    for (int e = 0; e < 9; ++e) pairs.emplace_back(i, i + 2 + random.below(59));
  }
  const BlockPattern band = pattern_of(2000, pairs);
  CHECK(elimination_order(band).node == numbers(2000));
  CHECK(elimination_order(band).multiplications <
        0.7 * approximate_minimum_degree(band).multiplications);
  CHECK(natural_order({}).node.empty());
}

TEST_CASE("columns of the factor are counted as elimination fills them, in any order") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 300; ++k) {
    const Index n = 1 + random.below(40);
    test::Pairs pairs;
    for (Index e = random.below(3 * n); e > 0; --e) {
      const Index i = random.below(n), j = random.below(n);
      if (i != j) pairs.emplace_back(i, j);
    }
    const BlockPattern pattern = pattern_of(n, pairs);
    const std::vector<Index> order = random_order(random, n).node;
    const std::vector<Index> counts = factor_column_counts(pattern, order);
    const auto rows = rows_of_factor(pattern, order);
    CAPTURE(k);
    REQUIRE(counts.size() == rows.size());
    for (std::size_t j = 0; j < rows.size(); ++j) REQUIRE(counts[j] == 1 + rows[j].size());
  }
}

TEST_CASE("Eigen's order is one of all nodes, fills about as little, and is counted exactly") {
  Random random;
  INFO(random.replay());
  double fill = 0.0, fill_by_eigen = 0.0;
  for (int k = 0; k < 100; ++k) {
    const Index n = 1 + random.below(60);
    const auto pairs = test::random_connected(random, n, random.below(2 * n));
    const BlockPattern pattern = pattern_of(n, pairs);
    const EliminationOrder order = eigen_minimum_degree(pattern);
    REQUIRE(order.multiplications == multiplications_of(rows_of_factor(pattern, order.node)));
    fill += approximate_minimum_degree(pattern).nonzeros;
    fill_by_eigen += order.nonzeros;
  }
  CHECK(fill_by_eigen < 1.1 * fill);
  CHECK(eigen_minimum_degree({}).node.empty());
  BlockPattern beyond;
  beyond.start = {0, 1};
  beyond.row = {1};
  CHECK_THROWS_AS(eigen_minimum_degree(beyond), std::logic_error);
}

#include <algorithm>
#include <cmath>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/multifrontal.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>

#include "support/blocks.hpp"
#include "support/dense.hpp"
#include "support/graphs.hpp"
#include "support/random.hpp"

using Eigen::MatrixXd;
using namespace rotavg;
using rotavg::test::Random;
using One = std::integral_constant<int, 1>;
using Three = std::integral_constant<int, 3>;
using Four = std::integral_constant<int, 4>;

namespace {

/// By the largest sum of a row (Gershgorin).
MatrixXd made_positive_definite(const MatrixXd& A) {
  return test::shifted(A, 1.0 + A.cwiseAbs().rowwise().sum().maxCoeff());
}

struct Graph {
  const char* name;
  Index n;
  test::Pairs pairs;
};

test::Pairs star(Index n, Index hub) {
  test::Pairs pairs;
  for (Index i = 0; i < n; ++i) {
    if (i != hub) pairs.emplace_back(hub, i);
  }
  return pairs;
}

std::vector<Graph> graphs(Random& random) {
  std::vector<Graph> all = {{"one node", 1, {}},
                            {"two nodes", 2, test::path(2)},
                            {"no edges", 20, {}},
                            {"path", 50, test::path(50)},
                            {"cycle", 33, test::cycle(33)},
                            {"grid", 63, test::grid(7, 9)},
                            {"complete", 45, test::complete(45)},
                            {"large complete", 110, test::complete(110)},
                            {"arrow, hub first", 60, star(60, 0)},
                            {"arrow, hub last", 60, star(60, 59)},
                            {"tree", 80, test::random_connected(random, 80, 0)},
                            {"sparse", 70, test::random_connected(random, 70, 40)},
                            {"denser", 60, test::random_connected(random, 60, 300)}};
  Graph several{"several components", 70, test::grid(5, 6)};
  for (auto [i, j] : test::complete(12)) several.pairs.emplace_back(i + 40, j + 40);
  for (auto [i, j] : test::path(10)) several.pairs.emplace_back(i + 55, j + 55);
  all.push_back(several);
  return all;
}

template <int B>
void check_solve(Random& random, BlockCholesky<B>& cholesky, const MatrixXd& A) {
  for (const Eigen::Index columns : {1, 3, 8}) {
    const MatrixXd X = test::normal_matrix(random, A.rows(), columns);
    REQUIRE((cholesky.solve(A * X) - X).norm() <= 1e-11 * X.norm());
  }
}

}  // namespace

TEST_CASE_TEMPLATE("block Cholesky factorises, solves and tells what is indefinite", Size, One,
                   Three, Four) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  for (const Graph& graph : graphs(random)) {
    for (const bool shuffled : {false, true}) {
      CAPTURE(B);
      CAPTURE(graph.name);
      CAPTURE(shuffled);
      const MatrixXd A =
          made_positive_definite(test::random_symmetric<B>(random, graph.n, graph.pairs));
      const auto sparse = test::sparse_blocks<B>(A);
      BlockCholesky<B> cholesky(test::analysed(random, sparse.pattern, shuffled));
      REQUIRE(cholesky.size() == A.rows());
      REQUIRE(cholesky.factorize(sparse.blocks) == CholeskyOutcome::positive_definite);
      const MatrixXd PAP = test::permuted<B>(A, *cholesky.symbolic());
      const MatrixXd L = PAP.llt().matrixL();
      REQUIRE((test::dense_factor(cholesky) - L).norm() <= 1e-13 * L.norm());
      check_solve(random, cholesky, A);

      // Other values in the same pattern, all of them negative definite.
      auto blocks = sparse.blocks;
      for (auto& block : blocks) block = -block;
      REQUIRE(cholesky.factorize(blocks) == CholeskyOutcome::not_positive_definite);
      // A shift mends that, and a failure spoils nothing.
      const double shift = 2.0 * A.cwiseAbs().rowwise().sum().maxCoeff();
      REQUIRE(cholesky.factorize(blocks, shift) == CholeskyOutcome::positive_definite);
      check_solve(random, cholesky, test::shifted(-A, shift));

      // The same bits again, and from a fresh object.
      REQUIRE(cholesky.factorize(sparse.blocks) == CholeskyOutcome::positive_definite);
      BlockCholesky<B> fresh(cholesky.symbolic());
      fresh.factorize(sparse.blocks);
      REQUIRE(test::dense_factor(cholesky) == test::dense_factor(fresh));
      const MatrixXd X = test::normal_matrix(random, A.rows(), 2);
      REQUIRE(cholesky.solve(X) == fresh.solve(X));
      // Each right-hand side is solved for itself.
      REQUIRE(cholesky.solve(X.rightCols(1)) == cholesky.solve(X).rightCols(1));
      REQUIRE(cholesky.solve(MatrixXd(A.rows(), 0)).cols() == 0);
      REQUIRE(cholesky.solve(MatrixXd::Zero(A.rows(), 2)) == MatrixXd::Zero(A.rows(), 2));
    }
  }
}

TEST_CASE_TEMPLATE("the outcome turns where the smallest eigenvalue does", Size, One, Three, Four) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 40; ++k) {
    const Index n = 1 + random.below(25);
    const auto pairs =
        n > 1 ? test::random_connected(random, n, random.below(2 * n)) : test::Pairs{};
    const MatrixXd A = test::random_symmetric<B>(random, n, pairs);
    const auto sparse = test::sparse_blocks<B>(A);
    BlockCholesky<B> cholesky(test::analysed(random, sparse.pattern, random.coin()));
    const double lambda_min = test::dense_eigenvalues(A)(0);
    for (const double margin : {1e-3, -1e-3, 1.0, -1.0, 1e-9, -1e-9}) {
      CAPTURE(B);
      CAPTURE(n);
      CAPTURE(margin);
      const auto outcome = cholesky.factorize(sparse.blocks, margin - lambda_min);
      const auto shifted = test::sparse_blocks<B>(test::shifted(A, margin - lambda_min));
      CHECK(definiteness<B>(cholesky.symbolic(), shifted.blocks, 1 + k % 3, {}) == outcome);
      REQUIRE(outcome == (margin > 0.0 ? CholeskyOutcome::positive_definite
                                       : CholeskyOutcome::not_positive_definite));
      if (margin < 1e-3) continue;
      const MatrixXd b = test::normal_matrix(random, A.rows(), 1);
      const MatrixXd residual = test::shifted(A, margin - lambda_min) * cholesky.solve(b) - b;
      REQUIRE(residual.norm() <= 1e-9 * b.norm());
    }
  }
}

TEST_CASE_TEMPLATE("NaN, infinity and zero pivots are not positive definite", Size, One, Three,
                   Four) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  const test::Pairs pairs = test::grid(4, 4);
  const auto sparse =
      test::sparse_blocks<B>(made_positive_definite(test::random_symmetric<B>(random, 16, pairs)));
  BlockCholesky<B> cholesky(test::analysed(random, sparse.pattern, true));
  REQUIRE(cholesky.factorize(sparse.blocks) == CholeskyOutcome::positive_definite);
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    for (std::size_t e = 0; e < sparse.blocks.size(); ++e) {
      for (int i = 0; i < B; ++i) {
        for (int j = 0; j <= i; ++j) {
          auto blocks = sparse.blocks;
          blocks[e](i, j) = bad;
          CAPTURE(bad);
          CAPTURE(e);
          REQUIRE(cholesky.factorize(blocks) == CholeskyOutcome::not_positive_definite);
        }
      }
    }
    REQUIRE(cholesky.factorize(sparse.blocks, bad) == CholeskyOutcome::not_positive_definite);
  }
  const auto zero = test::sparse_blocks<B>(MatrixXd::Zero(B * 3, B * 3));
  BlockCholesky<B> of_zero(test::analysed(random, zero.pattern, false));
  CHECK(of_zero.factorize(zero.blocks) == CholeskyOutcome::not_positive_definite);
  CHECK(of_zero.factorize(zero.blocks, -0.0) == CholeskyOutcome::not_positive_definite);
  CHECK(of_zero.factorize(zero.blocks, 1e-300) == CholeskyOutcome::positive_definite);
}

TEST_CASE("it stops at whichever question is answered with no, and can start anew") {
  Random random;
  INFO(random.replay());
  test::Pairs pairs = test::complete(150);
  for (auto [i, j] : test::grid(10, 15)) pairs.emplace_back(i + 150, j + 150);
  const auto sparse =
      test::sparse_blocks<3>(made_positive_definite(test::random_symmetric<3>(random, 300, pairs)));
  const auto symbolic = test::analysed(random, sparse.pattern, false);
  int asked = 0;
  BlockCholesky<3> complete(symbolic);
  REQUIRE(complete.factorize(sparse.blocks, 0.0, [&] { return ++asked > 0; }) ==
          CholeskyOutcome::positive_definite);
  const int questions = asked;
  CHECK(questions >= 3);
  CHECK(questions <= 100);
  for (int allowed = 0; allowed < questions; ++allowed) {
    asked = 0;
    BlockCholesky<3> cholesky(symbolic);
    const auto keep_going = [&] { return asked++ != allowed; };
    CAPTURE(allowed);
    REQUIRE(cholesky.factorize(sparse.blocks, 0.0, keep_going) == CholeskyOutcome::stopped);
    REQUIRE(asked == allowed + 1);
  }
  BlockCholesky<3> cholesky(symbolic);
  CHECK(cholesky.factorize(sparse.blocks, 0.0, [] { return false; }) == CholeskyOutcome::stopped);
  CHECK(cholesky.factorize(sparse.blocks) == CholeskyOutcome::positive_definite);
  CHECK(test::dense_factor(cholesky) == test::dense_factor(complete));
}

TEST_CASE_TEMPLATE("any number of threads gives the same bits, and stops where it is told to", Size,
                   One, Three) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  std::vector<Graph> all = graphs(random);
  all.push_back({"large grid", 1600, test::grid(40, 40)});
  Graph band{"band", 1600, {}};
  for (Index i = 0; i < band.n; ++i) {
    for (Index d = 1; d <= 12 && i + d < band.n; ++d) band.pairs.emplace_back(i, i + d);
  }
  all.push_back(band);
  all.push_back({"expander", 400, test::random_connected(random, 400, 1200)});
  for (const Graph& graph : all) {
    // Diagonally dominant, block by block.
    BlockPattern pattern;
    typename BlockCholesky<B>::Blocks blocks;
    std::vector<std::vector<Index>> below(static_cast<std::size_t>(graph.n));
    for (const auto& [i, j] : graph.pairs) below[std::min(i, j)].push_back(std::max(i, j));
    std::vector<double> degree(below.size(), 1.0);
    for (Index j = 0; j < graph.n; ++j) {
      auto& rows = below[j];
      std::sort(rows.begin(), rows.end());
      rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
      pattern.row.push_back(j);
      blocks.emplace_back();
      for (const Index i : rows) {
        pattern.row.push_back(i);
        blocks.push_back(test::normal_matrix(random, B, B));
        const double size = blocks.back().norm();
        degree[i] += size;
        degree[j] += size;
      }
      pattern.start.push_back(static_cast<Index>(pattern.row.size()));
    }
    for (Index j = 0; j < graph.n; ++j) {
      blocks[pattern.start[j]] = degree[j] * Eigen::Matrix<double, B, B>::Identity();
    }
    const auto symbolic = test::analysed(random, pattern, false);
    const MatrixXd X = test::normal_matrix(random, B * graph.n, 5);
    BlockCholesky<B> one(symbolic);
    REQUIRE(one.factorize(blocks) == CholeskyOutcome::positive_definite);
    MatrixXd AX = MatrixXd::Zero(X.rows(), X.cols());
    for (Index j = 0; j < graph.n; ++j) {
      for (Index e = pattern.start[j]; e < pattern.start[j + 1]; ++e) {
        const Index i = pattern.row[e];
        AX.middleRows<B>(B * i) += blocks[e] * X.middleRows<B>(B * j);
        if (i != j) AX.middleRows<B>(B * j) += blocks[e].transpose() * X.middleRows<B>(B * i);
      }
    }
    REQUIRE((one.solve(AX) - X).norm() <= 1e-10 * X.norm());
    for (const int num_threads : {2, 3, 8}) {
      CAPTURE(B);
      CAPTURE(graph.name);
      CAPTURE(num_threads);
      BlockCholesky<B> several(symbolic, num_threads);
      for (int times = 0; times < 3; ++times) {
        REQUIRE(several.factorize(blocks) == CholeskyOutcome::positive_definite);
        for (std::size_t s = 0; s < symbolic->supernodes().size(); ++s) {
          const MatrixXd L = several.factor(s), expected = one.factor(s);
          REQUIRE(MatrixXd(L.template triangularView<Eigen::Lower>()) ==
                  MatrixXd(expected.template triangularView<Eigen::Lower>()));
        }
        REQUIRE(several.solve(X) == one.solve(X));
      }
      int left = 2;
      const auto outcome = several.factorize(blocks, 0.0, [&] { return left-- > 0; });
      REQUIRE((left >= 0 || outcome == CholeskyOutcome::stopped));
      REQUIRE(several.factorize(blocks, -1e6) == CholeskyOutcome::not_positive_definite);
    }
  }
}

TEST_CASE("a matrix without rows is positive definite, and solves nothing") {
  BlockCholesky<3> cholesky(std::make_shared<SymbolicCholesky>(BlockPattern{}, EliminationOrder{}));
  CHECK(cholesky.size() == 0);
  CHECK(cholesky.factorize({}) == CholeskyOutcome::positive_definite);
  CHECK(cholesky.solve(MatrixXd(0, 3)).cols() == 3);
  CHECK(cholesky.rounding_trace() == 0.0);
}

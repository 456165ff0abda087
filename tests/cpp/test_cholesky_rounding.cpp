#include <cmath>
#include <limits>
#include <type_traits>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Core>

#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>

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
using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

namespace {

/// The Laplacian of a random graph with small whole weights, plus one shift on the diagonal: its
/// smallest eigenvalue is exactly the shift, and so is every entry.
MatrixXd shifted_laplacian(Random& random, Index n, double shift) {
  MatrixXd L = MatrixXd::Zero(n, n);
  for (Index i = 1; i < n; ++i) {
    for (Index k = 0; k < 3; ++k) {
      const Index j = random.below(i);
      const double weight = 1.0 + random.below(8);
      L(i, j) -= weight;
      L(j, i) -= weight;
    }
  }
  for (Index i = 0; i < n; ++i) L(i, i) = shift - (L.row(i).sum() - L(i, i));
  return L;
}

}  // namespace

TEST_CASE_TEMPLATE("rounding_trace covers the true error of L, by a modest factor", Size, One,
                   Three, Four) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 30; ++k) {
    const Index n = 1 + random.below(120 / B);
    const auto pairs =
        n > 1 ? test::random_connected(random, n, random.below(3 * n)) : test::Pairs{};
    // Barely positive definite, as here the errors are largest.
    const MatrixXd A = test::random_symmetric<B>(random, n, pairs);
    const double shift = 1e-9 - test::dense_eigenvalues(A)(0);
    const auto sparse = test::sparse_blocks<B>(A);
    BlockCholesky<B> cholesky(test::analysed(random, sparse.pattern, random.coin()));
    REQUIRE(cholesky.factorize(sparse.blocks, shift) == CholeskyOutcome::positive_definite);

    const LongMatrix L = test::dense_factor(cholesky).template cast<long double>();
    LongMatrix exact = test::permuted<B>(A, *cholesky.symbolic()).template cast<long double>();
    exact.diagonal().array() += static_cast<long double>(shift);
    const LongMatrix E = L * L.transpose() - exact;
    // A diagonal of row sums dominates a bound on each entry, k_i as counted from L itself.
    const MatrixXd magnitude = test::dense_factor(cholesky).cwiseAbs();
    const Eigen::VectorXd k_i =
        (magnitude.array() > 0.0).template cast<double>().rowwise().sum() + 2.0;
    const MatrixXd a = k_i.cwiseSqrt().asDiagonal() * magnitude;
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    const MatrixXd bound = unit / (1.0 - unit * k_i.maxCoeff()) * a * a.transpose();
    CAPTURE(B);
    CAPTURE(n);
    REQUIRE((E.cwiseAbs().template cast<double>().array() <= bound.array()).all());
    REQUIRE(bound.sum() <= cholesky.rounding_trace() * (1.0 + 1e-12));
    const double size = static_cast<double>(A.rows());
    REQUIRE(cholesky.rounding_trace() <=
            1.2e-16 * (size + 2.0 + B) * size * static_cast<double>(exact.trace()));
  }
}

TEST_CASE_TEMPLATE("what passes for positive definite is so up to rounding_trace", Size, One,
                   Three) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  int passed_though_negative = 0;
  for (int k = 0; k < 300; ++k) {
    const Index n = 2 + random.below(150 / B);
    // lambda_min = -2^-exponent exactly: the entries are whole multiples of it (53 bits hold them),
    // or the factorisation adds it as a shift. Its eigenvectors are the same at every node.
    const bool as_shift = random.coin();
    const double lambda_min = -std::ldexp(1.0, -30 - random.below(as_shift ? 30 : 13));
    const MatrixXd L = shifted_laplacian(random, n, as_shift ? 0.0 : lambda_min);
    MatrixXd A = MatrixXd::Zero(B * n, B * n);  // L (x) I
    for (int c = 0; c < B; ++c) {
      for (Index j = 0; j < n; ++j) {
        for (Index i = 0; i < n; ++i) A(B * i + c, B * j + c) = L(i, j);
      }
    }
    const auto sparse = test::sparse_blocks<B>(A);
    BlockCholesky<B> cholesky(test::analysed(random, sparse.pattern, random.coin()));
    const auto outcome = cholesky.factorize(sparse.blocks, as_shift ? lambda_min : 0.0);
    if (outcome != CholeskyOutcome::positive_definite) continue;
    ++passed_though_negative;
    CAPTURE(n);
    CAPTURE(lambda_min);
    // x^T D x >= -lambda_min at the eigenvectors, where x_i^2 = 1 / n.
    REQUIRE(-lambda_min * B * n <= cholesky.rounding_trace());
  }
  CHECK(passed_though_negative > 0);  // or the test would say nothing
}

TEST_CASE_TEMPLATE("cholesky_rounding covers the true error, known before the factorisation", Size,
                   One, Three, Four) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 30; ++k) {
    const Index n = 1 + random.below(120 / B);
    const auto pairs =
        n > 1 ? test::random_connected(random, n, random.below(3 * n)) : test::Pairs{};
    MatrixXd A = test::random_symmetric<B>(random, n, pairs);
    A.diagonal().array() += 1e-9 - test::dense_eigenvalues(A)(0);
    // Rows of very different size, as weights make them.
    Eigen::VectorXd scale(A.rows());
    for (Index a = 0; a < n; ++a) {
      scale.segment(B * a, B).setConstant(std::ldexp(1.0, random.below(40) - 20));
    }
    A = scale.asDiagonal() * A * scale.asDiagonal();  // exact
    const auto sparse = test::sparse_blocks<B>(A);
    const auto symbolic = test::analysed(random, sparse.pattern, random.coin());
    BlockCholesky<B> cholesky(symbolic);
    REQUIRE(cholesky.factorize(sparse.blocks) == CholeskyOutcome::positive_definite);

    const LongMatrix L = test::dense_factor(cholesky).template cast<long double>();
    const LongMatrix exact = test::permuted<B>(A, *symbolic).template cast<long double>();
    const MatrixXd E = (L * L.transpose() - exact).cwiseAbs().template cast<double>();
    const std::vector<double> bound = cholesky_rounding(*symbolic, B);
    // diag(bound a) - E, scaled to a unit diagonal of A, has rows that are not negative.
    for (Index i = 0; i < A.rows(); ++i) {
      double sum = 0.0;
      for (Index j = 0; j < A.rows(); ++j) {
        sum += E(i, j) / std::sqrt(double(exact(i, i)) * double(exact(j, j)));
      }
      CAPTURE(B);
      CAPTURE(n);
      REQUIRE(sum <= bound[symbolic->node()[i / B]]);
    }
    for (const double entry : bound) {
      const double size = static_cast<double>(A.rows());
      REQUIRE(entry <= 1.2e-16 * (size + 2.0) * size);
    }
  }
}

TEST_CASE_TEMPLATE("what passes after the shift by cholesky_rounding is positive semidefinite",
                   Size, One, Three) {
  constexpr int B = Size::value;
  Random random;
  INFO(random.replay());
  int passed_as_it_is = 0;
  for (int k = 0; k < 300; ++k) {
    const Index n = 2 + random.below(150 / B);
    const double lambda_min = -std::ldexp(1.0, -30 - random.below(30));  // as above, a shift
    const MatrixXd L = shifted_laplacian(random, n, 0.0);
    MatrixXd A = MatrixXd::Zero(B * n, B * n);  // L (x) I
    for (int c = 0; c < B; ++c) {
      for (Index j = 0; j < n; ++j) {
        for (Index i = 0; i < n; ++i) A(B * i + c, B * j + c) = L(i, j);
      }
    }
    const auto symbolic = test::analysed(random, test::sparse_blocks<B>(A).pattern, random.coin());
    BlockCholesky<B> cholesky(symbolic);
    const auto as_it_is = cholesky.factorize(test::sparse_blocks<B>(A).blocks, lambda_min);
    passed_as_it_is += as_it_is == CholeskyOutcome::positive_definite ? 1 : 0;
    const std::vector<double> bound = cholesky_rounding(*symbolic, B);
    for (Index i = 0; i < A.rows(); ++i) A(i, i) -= bound[i / B] * A(i, i);
    CAPTURE(n);
    CAPTURE(lambda_min);
    REQUIRE(cholesky.factorize(test::sparse_blocks<B>(A).blocks, lambda_min) ==
            CholeskyOutcome::not_positive_definite);
  }
  CHECK(passed_as_it_is > 0);  // or the test would say nothing
}

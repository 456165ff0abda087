#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/QR>

#include <rotavg/linalg/cholesky.hpp>
#include <rotavg/linalg/lobpcg.hpp>

#include "support/dense.hpp"
#include "support/random.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;
using namespace rotavg;
using rotavg::test::Random;
using Outcome = SparseCholesky::Outcome;

namespace {

MatrixXd normal_matrix(Random& random, Eigen::Index rows, Eigen::Index columns) {
  return MatrixXd::NullaryExpr(rows, columns,
                               [&](Eigen::Index, Eigen::Index) { return random.normal(); });
}

MatrixXd orthonormal(Random& random, Eigen::Index rows, Eigen::Index columns) {
  const Eigen::HouseholderQR<MatrixXd> qr(normal_matrix(random, rows, columns));
  return qr.householderQ() * MatrixXd::Identity(rows, columns);
}

MatrixXd with_eigenvalues(Random& random, const VectorXd& eigenvalues) {
  const MatrixXd Q = orthonormal(random, eigenvalues.size(), eigenvalues.size());
  const MatrixXd A = Q * eigenvalues.asDiagonal() * Q.transpose();
  return 0.5 * (A + A.transpose());
}

/// Symmetric with about `per_row` entries in a row, and eigenvalues of both signs.
MatrixXd sparse_symmetric(Random& random, Index n, Index per_row) {
  MatrixXd A = MatrixXd::Zero(n, n);
  for (Index i = 0; i < n; ++i) {
    A(i, i) = random.normal();
    for (Index k = 0; k < per_row / 2; ++k) {
      const Index j = random.below(n);
      A(i, j) = A(j, i) = random.normal();
    }
  }
  return A;
}

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

LinearOperator times(const MatrixXd& A) {
  return [A](const MatrixXd& X) -> MatrixXd { return A * X; };
}

}  // namespace

TEST_CASE("sparse Cholesky solves like a dense factorisation") {
  Random random;
  INFO(random.replay());
  for (const Index n : {1, 2, 3, 10, 100}) {
    MatrixXd A = sparse_symmetric(random, n, 4);
    A.diagonal().array() += 1.0 - std::min(0.0, test::dense_eigenvalues(A)(0));
    const SparseSymmetric lower = test::sparse_lower(A);
    SparseCholesky cholesky(lower);
    CAPTURE(n);
    CHECK(cholesky.size() == n);
    CHECK(cholesky.flops() > 0.0);
    REQUIRE(cholesky.factorize(lower, 0.0, {}) == Outcome::positive_definite);
    const MatrixXd B = normal_matrix(random, n, 3);
    CHECK((cholesky.solve(B) - A.llt().solve(B)).norm() < 1e-11 * B.norm());
  }
}

TEST_CASE("sparse Cholesky tells positive definite from indefinite, at any shift") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const MatrixXd A = sparse_symmetric(random, 1 + random.below(40), 4);
    const SparseSymmetric lower = test::sparse_lower(A);
    const double lambda_min = test::dense_eigenvalues(A)(0);
    SparseCholesky cholesky(lower);
    // One object, many shifts: a failure must not spoil what follows.
    for (const double margin : {1e-3, -1e-3, 1.0, -1.0, 1e-9, -1e-9}) {
      CAPTURE(margin);
      const Outcome outcome = cholesky.factorize(lower, margin - lambda_min, {});
      REQUIRE(outcome ==
              (margin > 0.0 ? Outcome::positive_definite : Outcome::not_positive_definite));
      if (margin < 1e-3) continue;
      const MatrixXd shifted = A + (margin - lambda_min) * MatrixXd::Identity(A.rows(), A.cols());
      const MatrixXd b = normal_matrix(random, A.rows(), 1);
      REQUIRE((shifted * cholesky.solve(b) - b).norm() < 1e-9 * b.norm());
    }
  }
}

TEST_CASE("sparse Cholesky takes new values in an old pattern") {
  Random random;
  INFO(random.replay());
  MatrixXd A = shifted_laplacian(random, 50, 1.0);
  SparseCholesky cholesky(test::sparse_lower(A));
  for (int k = 0; k < 5; ++k) {
    const VectorXd scale = VectorXd::NullaryExpr(50, [&] { return random.uniform(0.5, 2.0); });
    A = scale.asDiagonal() * A * scale.asDiagonal();
    REQUIRE(cholesky.factorize(test::sparse_lower(A), 0.0, {}) == Outcome::positive_definite);
    const MatrixXd b = normal_matrix(random, 50, 1);
    REQUIRE((A * cholesky.solve(b) - b).norm() < 1e-9 * b.norm());
  }
}

TEST_CASE("sparse Cholesky stops when it is told to, and can start anew") {
  Random random;
  INFO(random.replay());
  const SparseSymmetric lower = test::sparse_lower(shifted_laplacian(random, 50, 1.0));
  SparseCholesky cholesky(lower);
  CHECK(cholesky.factorize(lower, 0.0, [] { return false; }) == Outcome::stopped);
  CHECK(cholesky.factorize(lower, 0.0, [] { return true; }) == Outcome::positive_definite);
}

TEST_CASE("a NaN, an infinity and a zero on the diagonal are not positive definite") {
  for (const double bad : {std::nan(""), -HUGE_VAL, 0.0, -0.0}) {
    for (Index at = 0; at < 4; ++at) {
      SparseSymmetric lower = test::sparse_lower(MatrixXd::Identity(4, 4));
      SparseCholesky cholesky(lower);
      lower.coeffRef(at, at) = bad;
      CAPTURE(bad);
      CAPTURE(at);
      CHECK(cholesky.factorize(lower, 0.0, {}) == Outcome::not_positive_definite);
    }
  }
}

TEST_CASE("what passes for positive definite is so up to rounding_trace, with exact eigenvalues") {
  Random random;
  INFO(random.replay());
  int passed_though_negative = 0;
  for (int k = 0; k < 500; ++k) {
    const Index n = 2 + random.below(150);
    // lambda_min = -2^-exponent exactly: the entries are whole multiples of it (53 bits hold them),
    // or the factorisation adds it as a shift.
    const bool as_shift = random.coin();
    const double lambda_min = -std::ldexp(1.0, -30 - random.below(as_shift ? 30 : 13));
    const MatrixXd A = shifted_laplacian(random, n, as_shift ? 0.0 : lambda_min);
    const SparseSymmetric lower = test::sparse_lower(A);
    SparseCholesky cholesky(lower);
    if (cholesky.factorize(lower, as_shift ? lambda_min : 0.0, {}) != Outcome::positive_definite) {
      continue;
    }
    ++passed_though_negative;
    CAPTURE(n);
    CAPTURE(lambda_min);
    REQUIRE(-lambda_min <= cholesky.rounding_trace());
  }
  CHECK(passed_though_negative > 0);  // or the test would say nothing
}

TEST_CASE("rounding_trace covers the true error of a dense factorisation, by a modest factor") {
  Random random;
  INFO(random.replay());
  using Long = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  for (int k = 0; k < 200; ++k) {
    // The bound holds for any order of rows and operations; the dense factor stands for them all.
    const Index n = 1 + random.below(30);
    const MatrixXd B = normal_matrix(random, n, n + 2);
    const MatrixXd A = B * B.transpose();
    const SparseSymmetric lower = test::sparse_lower(A);
    SparseCholesky cholesky(lower);
    REQUIRE(cholesky.factorize(lower, 0.0, {}) == Outcome::positive_definite);
    const MatrixXd L = A.llt().matrixL();
    const Long error = L.cast<long double>() * L.transpose().cast<long double>() -
                       MatrixXd(A.selfadjointView<Eigen::Lower>()).cast<long double>();
    const auto actual = static_cast<double>(error.cwiseAbs().sum());
    CAPTURE(n);
    REQUIRE(actual <= cholesky.rounding_trace());
    REQUIRE(cholesky.rounding_trace() <= 1e-15 * (n + 1) * (n + 1) * A.trace());
  }
}

TEST_CASE("LOBPCG finds the smallest eigenvalue of random symmetric matrices, tiny ones too") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 200; ++k) {
    const Index n = 1 + random.below(60);
    const MatrixXd A = sparse_symmetric(random, n, 6);
    const double expected = test::dense_eigenvalues(A)(0);
    LobpcgOptions options;
    options.tolerance = 1e-9 * A.norm();
    const auto start = random_start(n, std::min<Index>(4, n));
    const Eigenpair pair = smallest_eigenpair(times(A), {}, start, MatrixXd(n, 0), options);
    CAPTURE(n);
    REQUIRE(pair.converged);
    REQUIRE(pair.vector.norm() == doctest::Approx(1.0).epsilon(1e-12));
    REQUIRE((A * pair.vector - pair.value * pair.vector).norm() ==
            doctest::Approx(pair.residual).epsilon(1e-3).scale(A.norm() * 1e-12));
    REQUIRE(std::abs(pair.value - expected) <= 1e-9 * A.norm());
  }
}

TEST_CASE("LOBPCG stays on the complement of its constraints") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 100; ++k) {
    const Index n = 5 + random.below(40);
    const Index c = 1 + random.below(3);
    const VectorXd spectrum = VectorXd::LinSpaced(n, -1.0, 1.0 + random.uniform(0.0, 1.0));
    const MatrixXd Q = orthonormal(random, n, n);
    const MatrixXd A = Q * spectrum.asDiagonal() * Q.transpose();
    // The lowest eigenvectors are ruled out: the next one is the smallest.
    LobpcgOptions options;
    options.tolerance = 1e-9;
    const Eigenpair pair = smallest_eigenpair(times(A), {}, random_start(n, std::min(n - c, 3)),
                                              Q.leftCols(c), options);
    CAPTURE(n);
    REQUIRE(pair.converged);
    REQUIRE(pair.value == doctest::Approx(spectrum(c)).epsilon(1e-9));
    REQUIRE((Q.leftCols(c).transpose() * pair.vector).norm() < 1e-12);
  }
}

TEST_CASE("LOBPCG copes with eigenvalues that are equal or nearly so") {
  Random random;
  INFO(random.replay());
  for (const double spread : {0.0, 1e-15, 1e-12, 1e-8, 1e-4}) {
    for (const Index multiplicity : {1, 3, 4, 6, 12}) {
      VectorXd spectrum = VectorXd::LinSpaced(40, 1.0, 5.0);
      for (Index k = 0; k < multiplicity; ++k) spectrum(k) = -1.0 + spread * k;
      const MatrixXd A = with_eigenvalues(random, spectrum);
      LobpcgOptions options;
      options.tolerance = 1e-10;
      const Eigenpair pair =
          smallest_eigenpair(times(A), {}, random_start(40, 4), MatrixXd(40, 0), options);
      CAPTURE(spread);
      CAPTURE(multiplicity);
      CHECK(std::abs(pair.value + 1.0) < 1e-8 + spread * multiplicity);
      CHECK(pair.value > -1.0 - 1e-13);
    }
  }
}

TEST_CASE("with the inverse as preconditioner LOBPCG needs a few iterations at any condition") {
  Random random;
  INFO(random.replay());
  const VectorXd exponents = VectorXd::LinSpaced(100, -8.0, 0.0);
  const VectorXd spectrum = exponents.unaryExpr([](double e) { return std::pow(10.0, e); });
  const MatrixXd A = with_eigenvalues(random, spectrum);
  const Eigen::LDLT<MatrixXd> factor(A);
  LobpcgOptions options;
  options.tolerance = 1e-14;
  const Eigenpair pair = smallest_eigenpair(
      times(A), [&](const MatrixXd& X) -> MatrixXd { return factor.solve(X); },
      random_start(100, 3), MatrixXd(100, 0), options);
  CHECK(pair.value == doctest::Approx(1e-8).epsilon(1e-6));
  CHECK(pair.iterations <= 30);
}

TEST_CASE("LOBPCG is at home at every scale, and does not give up on a residual it mistook") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20; ++k) {
    const MatrixXd A = with_eigenvalues(random, VectorXd::LinSpaced(30, -1.0, 3.0));
    for (const double scale : {1e-90, 1e-20, 1.0, 1e20, 1e90}) {
      LobpcgOptions options;
      options.tolerance = 1e-10 * scale;
      const Eigenpair pair =
          smallest_eigenpair(times(scale * A), {}, random_start(30, 3), MatrixXd(30, 0), options);
      CAPTURE(scale);
      CAPTURE(pair.iterations);
      CAPTURE(pair.residual / scale);
      CHECK(pair.converged);
      CHECK(pair.value / scale == doctest::Approx(-1.0).epsilon(1e-10));
    }
  }
}

TEST_CASE("LOBPCG stops at its limit or when told to, with a value that is still an upper bound") {
  Random random;
  INFO(random.replay());
  const MatrixXd A = with_eigenvalues(random, VectorXd::LinSpaced(200, -1.0, 1000.0));
  LobpcgOptions options;
  options.max_iterations = 3;
  const auto run = [&] {
    return smallest_eigenpair(times(A), {}, random_start(200, 2), MatrixXd(200, 0), options);
  };
  const Eigenpair limited = run();
  CHECK(!limited.converged);
  CHECK(limited.iterations == 3);
  CHECK(limited.value >= -1.0 - 1e-12);
  options.keep_going = [] { return false; };
  const Eigenpair stopped = run();
  CHECK(!stopped.converged);
  CHECK(stopped.iterations == 0);
  CHECK(stopped.value >= limited.value);
}

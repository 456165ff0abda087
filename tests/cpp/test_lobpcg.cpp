#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/QR>

#include <rotavg/linalg/lobpcg.hpp>

#include "support/dense.hpp"
#include "support/random.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;
using namespace rotavg;
using rotavg::test::Random;

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

LinearOperator times(const MatrixXd& A) {
  return [A](const MatrixXd& X) -> MatrixXd { return A * X; };
}

}  // namespace

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

#include <cmath>
#include <utility>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Core>
#include <Eigen/QR>

#include <rotavg/linalg/lanczos.hpp>

#include "support/dense.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

Eigen::MatrixXd symmetric(Random& random, Eigen::Index n) {
  const Eigen::MatrixXd A = Eigen::MatrixXd::NullaryExpr(
      n, n, [&](Eigen::Index, Eigen::Index) { return random.normal(); });
  return A + A.transpose();
}

Eigen::VectorXd vector(Random& random, Eigen::Index n) {
  return Eigen::VectorXd::NullaryExpr(n, [&](Eigen::Index) { return random.normal(); });
}

const auto anywhere = [](Eigen::VectorXd&) {};

}  // namespace

TEST_CASE("the smallest eigenvalue of tridiagonal matrices agrees with a dense solver's") {
  Random random;
  INFO(random.replay());
  for (std::size_t k = 1; k < 40; ++k) {
    std::vector<double> diagonal(k), beside(k - 1);
    const double scale = random.power_of_ten(-8.0, 8.0);
    for (double& a : diagonal) a = scale * random.normal();
    for (double& b : beside) b = scale * random.uniform(0.01, 2.0);
    Eigen::MatrixXd T = Eigen::MatrixXd::Zero(k, k);
    for (std::size_t a = 0; a < k; ++a) T(a, a) = diagonal[a];
    for (std::size_t a = 0; a + 1 < k; ++a) T(a, a + 1) = T(a + 1, a) = beside[a];
    const TridiagonalEigen eigen = smallest_tridiagonal_eigen(diagonal, beside);
    CAPTURE(k);
    CHECK(eigen.value == doctest::Approx(test::dense_eigenvalues(T)(0)).epsilon(1e-11));
    // The last entry of its vector, by Cramer's rule: the product of eigenvalue differences of T
    // without its last row over those of T.
    if (k == 1) CHECK(std::abs(eigen.last_entry) == doctest::Approx(1.0));
    if (k > 1 && k < 8) {
      const Eigen::VectorXd all = test::dense_eigenvalues(T);
      const Eigen::VectorXd minor = test::dense_eigenvalues(T.topLeftCorner(k - 1, k - 1));
      double square = 1.0;
      for (std::size_t a = 0; a + 1 < k; ++a) square *= (minor(a) - all(0)) / (all(a + 1) - all(0));
      CHECK(eigen.last_entry * eigen.last_entry == doctest::Approx(square).epsilon(1e-6));
    }
  }
}

TEST_CASE("Lanczos' method ends at the smallest eigenvalue, within its residual") {
  Random random;
  INFO(random.replay());
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Index n = 1 + random.below(80);
    const Eigen::MatrixXd A = symmetric(random, n);
    LanczosOptions options;
    options.relative_tolerance = trial % 2 == 0 ? 0.1 : 1e-8;
    const RitzValue ritz = smallest_ritz_value(
        [&](const Eigen::VectorXd& x) -> Eigen::VectorXd { return A.lazyProduct(x); }, anywhere,
        vector(random, n), options);
    const double expected = test::dense_eigenvalues(A)(0);
    CAPTURE(n);
    CHECK(ritz.converged);
    CHECK(ritz.value >= expected - 1e-10 * std::abs(expected));
    CHECK(ritz.value - ritz.residual <= expected + 1e-10 * std::abs(expected));
  }
}

TEST_CASE("it stays in the space that it is projected on, however short the vectors become") {
  Random random;
  INFO(random.replay());
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Index n = 3 + random.below(20);
    // Zero along the last axis, at least one elsewhere, with few different eigenvalues.
    Eigen::VectorXd eigenvalues(n);
    for (Eigen::Index k = 0; k < n; ++k) eigenvalues(k) = 1.0 + 1e-3 * random.below(3);
    eigenvalues(n - 1) = 0.0;
    const Eigen::MatrixXd Q = Eigen::MatrixXd(symmetric(random, n)).householderQr().householderQ();
    const auto apply = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
      return Q * eigenvalues.cwiseProduct(Q.transpose() * x);
    };
    const auto project = [&](Eigen::VectorXd& x) { x -= Q.col(n - 1) * Q.col(n - 1).dot(x); };
    Eigen::VectorXd start = vector(random, n);
    project(start);
    LanczosOptions options;
    options.relative_tolerance = 0.0;
    options.max_iterations = 50;
    CHECK(smallest_ritz_value(apply, project, start, options).value >= 1.0 - 1e-10);
  }
}

TEST_CASE("it stops when it is told to") {
  Random random;
  INFO(random.replay());
  const Eigen::MatrixXd A = symmetric(random, 60);
  LanczosOptions options;
  options.relative_tolerance = 0.0;
  int left = 7;
  options.keep_going = [&] { return left-- > 0; };
  const auto apply = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd { return A.lazyProduct(x); };
  CHECK_FALSE(smallest_ritz_value(apply, anywhere, vector(random, 60), options).converged);
  options.keep_going = {};
  options.max_iterations = 10;
  CHECK_FALSE(smallest_ritz_value(apply, anywhere, vector(random, 60), options).converged);
}

TEST_CASE("Lanczos' method stops where the value is known to be below what is asked for") {
  Random random;
  INFO(random.replay());
  const Eigen::MatrixXd A = symmetric(random, 200);
  int products = 0;
  const auto apply = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
    ++products;
    return A * x;
  };
  const Eigen::VectorXd start = vector(random, 200);
  LanczosOptions options;
  options.relative_tolerance = 1e-10;
  const double smallest = smallest_ritz_value(apply, anywhere, start, options).value;
  const int all = std::exchange(products, 0);
  options.enough = 0.5 * smallest;  // of a negative value: far above
  const RitzValue early = smallest_ritz_value(apply, anywhere, start, options);
  CHECK(early.value < options.enough);
  CHECK(early.value >= smallest - 1e-9 * std::abs(smallest));
  CHECK(products < all / 2);
  options.enough = 2.0 * smallest;  // never met
  CHECK(smallest_ritz_value(apply, anywhere, start, options).value ==
        doctest::Approx(smallest).epsilon(1e-9));
}

#include <cmath>

#include <doctest/doctest.h>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/small_inverse.hpp>

#include "support/random.hpp"

using Eigen::MatrixXd;
using namespace rotavg;
using rotavg::test::Random;

namespace {

/// Symmetric, with eigenvalues that rise evenly from `least` to 2.
MatrixXd with_spectrum(Random& random, Eigen::Index n, double least) {
  const MatrixXd any =
      MatrixXd::NullaryExpr(n, n, [&](Eigen::Index, Eigen::Index) { return random.normal(); });
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(any + any.transpose());
  return solver.eigenvectors() * Eigen::VectorXd::LinSpaced(n, least, 2.0).asDiagonal() *
         solver.eigenvectors().transpose();
}

}  // namespace

TEST_CASE("eigenvalues and vectors of small matrices are those of Eigen's solver") {
  Random random;
  INFO(random.replay());
  for (const Eigen::Index n : {1, 2, 3, 12, 40}) {
    const MatrixXd A = with_spectrum(random, n, -1.0);
    const SmallEigen found = small_eigen(A);
    const MatrixXd D = found.values.asDiagonal();
    REQUIRE(found.values.size() == n);
    CHECK((found.vectors * D * found.vectors.transpose() - A).norm() < 1e-12 * (1.0 + A.norm()));
    CHECK((found.vectors.transpose() * found.vectors - MatrixXd::Identity(n, n)).norm() < 1e-12);
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(A);
    CHECK((found.values - solver.eigenvalues()).norm() < 1e-12 * (1.0 + A.norm()));
  }
}

TEST_CASE("the inverse of small positive definite matrices is that of Eigen's LU") {
  Random random;
  INFO(random.replay());
  for (const Eigen::Index n : {1, 2, 3, 12, 40}) {
    const MatrixXd A = with_spectrum(random, n, 1e-3);
    MatrixXd inverse = A;
    REQUIRE(invert_positive_definite(inverse));
    CHECK((inverse - A.inverse()).norm() < 1e-9 * A.inverse().norm());
  }
}

TEST_CASE("a matrix that is not positive definite is not inverted") {
  Random random;
  INFO(random.replay());
  for (const double least : {-1e-6, -1.0}) {
    MatrixXd A = with_spectrum(random, 9, least);
    CHECK_FALSE(invert_positive_definite(A));
  }
  MatrixXd none = MatrixXd::Zero(3, 3);
  CHECK_FALSE(invert_positive_definite(none));
  MatrixXd nan = MatrixXd::Constant(2, 2, std::nan(""));
  CHECK_FALSE(invert_positive_definite(nan));
}

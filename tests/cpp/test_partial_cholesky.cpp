#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/parallel/interruption.hpp>

#include "support/random.hpp"

using Eigen::MatrixXd;
using namespace rotavg;
using rotavg::test::Random;

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Positive definite by diagonal dominance, yet with pivots that differ.
MatrixXd dominant(Random& random, Index n) {
  MatrixXd A(n, n);
  for (Index j = 0; j < n; ++j) {
    A(j, j) = n * random.uniform(1.0, 3.0);
    for (Index i = j + 1; i < n; ++i) A(i, j) = A(j, i) = random.uniform(-1.0, 1.0);
  }
  return A;
}

/// What PartialCholesky takes and returns, with NaN wherever it must not read.
struct Front {
  MatrixXd panel;
  MatrixXd rest;

  Front(const MatrixXd& A, Index pivots)
      : panel(A.leftCols(pivots)), rest(A.bottomRightCorner(A.rows() - pivots, A.rows() - pivots)) {
    panel.triangularView<Eigen::StrictlyUpper>().setConstant(not_a_number);
    rest.triangularView<Eigen::StrictlyUpper>().setConstant(not_a_number);
  }

  Index pivots() const { return static_cast<Index>(panel.cols()); }
  Index below() const { return static_cast<Index>(rest.cols()); }
  CholeskyOutcome factorize(PartialCholesky& cholesky, const std::function<bool()>& keep_going = {},
                            int num_threads = 1) {
    Interruption interruption(keep_going);
    return factorize(cholesky, interruption, num_threads);
  }
  CholeskyOutcome factorize(PartialCholesky& cholesky, Interruption& interruption,
                            int num_threads = 1) {
    return cholesky(panel.data(), pivots(), below(), rest.data(), interruption, num_threads);
  }
  MatrixXd L() const { return panel.triangularView<Eigen::Lower>(); }
  MatrixXd lower_rest() const { return rest.triangularView<Eigen::Lower>(); }
};

/// The same from the definition.
struct Expected {
  MatrixXd L;
  MatrixXd lower_rest;

  Expected(const MatrixXd& A, Index pivots) {
    const Index below = static_cast<Index>(A.rows()) - pivots;
    L = MatrixXd::Zero(A.rows(), pivots);
    MatrixXd rest = A.bottomRightCorner(below, below);
    if (pivots > 0) {  // Eigen refers to the first entry of what it factors and solves with
      const MatrixXd L11 = A.topLeftCorner(pivots, pivots).llt().matrixL();
      L.topRows(pivots) = L11;
      if (below > 0) {
        const MatrixXd A12 = A.topRightCorner(pivots, below);
        const MatrixXd L21 = L11.triangularView<Eigen::Lower>().solve(A12).transpose();
        L.bottomRows(below) = L21;  // L21 = A21 L11^-T
        rest -= L21 * L21.transpose();
      }
    }
    lower_rest = rest.triangularView<Eigen::Lower>();
  }
};

void check_size(Random& random, PartialCholesky& cholesky, Index pivots, Index below) {
  CAPTURE(pivots);
  CAPTURE(below);
  const MatrixXd A = dominant(random, pivots + below);
  Front front(A, pivots);
  REQUIRE(front.factorize(cholesky) == CholeskyOutcome::positive_definite);
  const Expected expected(A, pivots);
  const double tolerance = 1e-14 * (pivots + below);
  REQUIRE((front.L() - expected.L).norm() <= tolerance * expected.L.norm());
  REQUIRE((front.lower_rest() - expected.lower_rest).norm() <= tolerance * A.norm());
}

}  // namespace

TEST_CASE("every small size gives the factor and the rest of the definition, by one object") {
  Random random;
  INFO(random.replay());
  PartialCholesky cholesky;
  for (Index pivots = 0; pivots <= 40; ++pivots) {
    for (Index below = 0; below <= 40; ++below) check_size(random, cholesky, pivots, below);
  }
}

TEST_CASE("so do sizes around whole blocks of columns, in any order") {
  Random random;
  INFO(random.replay());
  PartialCholesky cholesky;
  for (const Index pivots : {300, 95, 96, 97, 108, 191, 192, 193, 98, 290}) {
    for (const Index below : {0, 1, 13, 96, 100}) check_size(random, cholesky, pivots, below);
  }
  check_size(random, cholesky, 1, 300);
  check_size(random, cholesky, 100, 300);
}

TEST_CASE("the same input gives the same bits, whatever the object has done before") {
  Random random;
  INFO(random.replay());
  const MatrixXd A = dominant(random, 150);
  PartialCholesky fresh, used;
  check_size(random, used, 200, 33);
  Front one(A, 110), other(A, 110);
  one.factorize(fresh);
  other.factorize(used);
  CHECK(one.L() == other.L());
  CHECK(one.lower_rest() == other.lower_rest());
}

TEST_CASE("any number of threads gives the same bits, and stops where it is told to") {
  Random random;
  INFO(random.replay());
  const MatrixXd A = dominant(random, 700);
  for (const Index pivots : {700, 400, 97, 12}) {
    PartialCholesky cholesky;
    Front one(A, pivots);
    REQUIRE(one.factorize(cholesky) == CholeskyOutcome::positive_definite);
    for (const int num_threads : {2, 3, 8}) {
      CAPTURE(pivots);
      CAPTURE(num_threads);
      Front several(A, pivots);
      REQUIRE(several.factorize(cholesky, {}, num_threads) == CholeskyOutcome::positive_definite);
      REQUIRE(several.L() == one.L());
      REQUIRE(several.lower_rest() == one.lower_rest());
    }
  }
  PartialCholesky cholesky;
  CHECK(Front(A, 700).factorize(cholesky, [] { return false; }, 3) == CholeskyOutcome::stopped);
}

TEST_CASE("nothing outside the panel and the rest is written") {
  Random random;
  INFO(random.replay());
  PartialCholesky cholesky;
  constexpr double canary = 12345.0;
  for (int k = 0; k < 100; ++k) {
    const Index pivots = random.below(120), below = random.below(30);
    const MatrixXd A = dominant(random, pivots + below);
    const auto with_canaries = [&](const MatrixXd& M) {
      std::vector<double> values(static_cast<std::size_t>(M.size()) + 64, canary);
      std::copy_n(M.data(), M.size(), values.data() + 32);
      return values;
    };
    std::vector<double> panel = with_canaries(A.leftCols(pivots));
    std::vector<double> rest = with_canaries(A.bottomRightCorner(below, below));
    const std::function<bool()> always;
    Interruption never(always);
    cholesky(panel.data() + 32, pivots, below, rest.data() + 32, never);
    for (const auto* values : {&panel, &rest}) {
      for (std::size_t i = 0; i < 32; ++i) {
        REQUIRE((*values)[i] == canary);
        REQUIRE((*values)[values->size() - 1 - i] == canary);
      }
    }
  }
}

TEST_CASE("a pivot that is not positive is found wherever it stands, one just positive passes") {
  Random random;
  INFO(random.replay());
  PartialCholesky cholesky;
  for (int k = 0; k < 200; ++k) {
    const Index pivots = 1 + random.below(k < 150 ? 40 : 250), below = random.below(20);
    const Index at = random.below(pivots);
    MatrixXd A = dominant(random, pivots + below);
    // The Schur complement at this pivot shall be `left`.
    const Expected expected(A, pivots);
    const double subtracted = expected.L.row(at).head(at).squaredNorm();
    CAPTURE(pivots);
    CAPTURE(at);
    for (const double left : {1e-6, -1e-6, -1.0, -1e300}) {
      A(at, at) = subtracted + left;
      const auto outcome = Front(A, at + 1).factorize(cholesky);
      REQUIRE(outcome == (left > 0.0 ? CholeskyOutcome::positive_definite
                                     : CholeskyOutcome::not_positive_definite));
    }
    REQUIRE(Front(A, pivots).factorize(cholesky) == CholeskyOutcome::not_positive_definite);
    // A failure does not spoil what follows.
    check_size(random, cholesky, pivots, below);
  }
}

TEST_CASE("a zero pivot is not positive") {
  PartialCholesky cholesky;
  for (const double zero : {0.0, -0.0}) {
    for (Index at = 0; at < 20; ++at) {
      MatrixXd A = MatrixXd::Identity(20, 20);
      A(at, at) = zero;
      CHECK(Front(A, 20).factorize(cholesky) == CholeskyOutcome::not_positive_definite);
      CHECK(Front(A, at).factorize(cholesky) == CholeskyOutcome::positive_definite);
    }
  }
}

TEST_CASE("a value that is not finite fails, or shows on the diagonal of the rest") {
  Random random;
  INFO(random.replay());
  PartialCholesky cholesky;
  for (const Index size : {7, 20, 110}) {
    const Index step = size < 100 ? 1 : 7;
    for (const Index pivots : {size, size / 2, 1}) {
      const MatrixXd A = dominant(random, size);
      for (const double bad : {not_a_number, infinity, -infinity}) {
        for (Index j = 0; j < pivots; j += step) {
          for (Index i = j; i < size; i += step) {
            Front front(A, pivots);
            front.panel(i, j) = bad;
            const auto outcome = front.factorize(cholesky);
            CAPTURE(size);
            CAPTURE(pivots);
            CAPTURE(i);
            CAPTURE(j);
            CAPTURE(bad);
            if (i < pivots) {
              REQUIRE(outcome == CholeskyOutcome::not_positive_definite);
            } else {
              REQUIRE(outcome == CholeskyOutcome::positive_definite);
              const double left = front.rest(i - pivots, i - pivots);
              REQUIRE((std::isnan(left) || left == -infinity));
            }
          }
        }
      }
    }
  }
}

TEST_CASE("numbers near the ends of the range: an overflow is no success, tiny pivots are one") {
  PartialCholesky cholesky;
  MatrixXd A = MatrixXd::Identity(2, 2);
  A(0, 0) = 1e-300;
  A(1, 0) = A(0, 1) = 1e200;  // L(1, 0) = 1e350
  CHECK(Front(A, 2).factorize(cholesky) == CholeskyOutcome::not_positive_definite);
  for (const double scale : {1e-300, 1e300}) {
    Random random;
    const MatrixXd B = dominant(random, 10) / 30.0;
    Front front(scale * B, 10);
    REQUIRE(front.factorize(cholesky) == CholeskyOutcome::positive_definite);
    CHECK((front.L() / std::sqrt(scale) - Expected(B, 10).L).norm() < 1e-14);
  }
}

TEST_CASE("it stops at whichever question is answered with no, and is whole again afterwards") {
  Random random;
  INFO(random.replay());
  constexpr Index pivots = 250, below = 400;
  const MatrixXd A = dominant(random, pivots + below);
  int asked = 0;
  Front complete(A, pivots);
  PartialCholesky fresh;
  REQUIRE(complete.factorize(fresh, [&] { return ++asked > 0; }) ==
          CholeskyOutcome::positive_definite);
  const int questions = asked;
  CHECK(questions >= 4);
  CHECK(questions <= 100);
  for (int allowed = 0; allowed < questions; ++allowed) {
    PartialCholesky cholesky;
    asked = 0;
    // Only one answer is no: what stopped it must not depend on being asked again.
    const auto keep_going = [&] { return asked++ != allowed; };
    CAPTURE(allowed);
    REQUIRE(Front(A, pivots).factorize(cholesky, keep_going) == CholeskyOutcome::stopped);
    REQUIRE(asked == allowed + 1);
    Front again(A, pivots);
    REQUIRE(again.factorize(cholesky) == CholeskyOutcome::positive_definite);
    REQUIRE(again.L() == complete.L());
    REQUIRE(again.lower_rest() == complete.lower_rest());
  }
}

TEST_CASE("work adds up over many small calls until it is asked whether to go on") {
  Random random;
  INFO(random.replay());
  const MatrixXd A = dominant(random, 20);
  PartialCholesky cholesky;
  const std::function<bool()> no = [] { return false; };
  Interruption interruption(no);
  int calls = 0;
  while (calls < 1000000) {
    ++calls;
    const auto outcome = Front(A, 10).factorize(cholesky, interruption);
    if (outcome == CholeskyOutcome::stopped) break;
  }
  CHECK(calls > 100);
  CHECK(calls < 100000);
}

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>
#include <Eigen/LU>
#include <Eigen/SVD>

#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/loso.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/svd.hpp>

#include "support/random.hpp"

using rotavg::loso;
using rotavg::loso_fast;
using rotavg::Matrix3;
using rotavg::nearest_rotation;
using rotavg::Vector3;
using rotavg::test::Random;

namespace {

/// U diag(s) V^T with random U and V, each with determinant +1.
Matrix3 with_singular_values(Random& random, const Vector3& s) {
  const Matrix3 U = random.rotation(), V = random.rotation();
  return U * s.asDiagonal() * V.transpose();
}

struct Family {
  std::string name;
  std::function<Matrix3(Random&)> draw;
};

double sign(Random& random) { return random.coin() ? 1.0 : -1.0; }

/// Kinds of matrices that have broken, or could break, a fast kernel.
const std::vector<Family>& families() {
  static const std::vector<Family> all = {
      {"normal entries", [](Random& r) { return r.normal_matrix(); }},
      {"sums of rotations", [](Random& r) { return Matrix3(r.rotation() + r.rotation()); }},
      {"rank two", [](Random& r) { return with_singular_values(r, {1.0, r.uniform(0, 1), 0.0}); }},
      {"rank one", [](Random& r) { return with_singular_values(r, {1.0, 0.0, 0.0}); }},
      {"exact rank one",
       [](Random& r) { return Matrix3(r.normal_vector() * r.normal_vector().transpose()); }},
      {"nearly rank deficient",
       [](Random& r) {
         const double s3 = sign(r) * r.power_of_ten(-20, 0);
         return with_singular_values(r, {1.0, r.power_of_ten(-20, 0), s3});
       }},
      {"sigma_2 = -sigma_3",
       [](Random& r) {
         const double s2 = r.uniform(0, 1);
         return with_singular_values(r, {sign(r), s2, -s2});
       }},
      {"sigma_2 close to -sigma_3",
       [](Random& r) {
         const double s2 = r.uniform(0, 1);
         const double s3 = -s2 * (1.0 + sign(r) * r.power_of_ten(-17, -2));
         return with_singular_values(r, {sign(r), s2, s3});
       }},
      {"around the border between formula and fallback",
       [](Random& r) {
         const double s2 = r.power_of_ten(-3, 0);
         return with_singular_values(r, {1.0, s2, -s2 * r.uniform(0.9, 1.0) + 0.01});
       }},
      {"nearly a multiple of a rotation or a reflection",
       [](Random& r) {
         const Matrix3 noise = r.power_of_ten(-18, 0) * r.normal_matrix();
         return Matrix3(sign(r) * r.rotation() + noise);
       }},
      {"entries -1, 0, 1",
       [](Random& r) {
         return Matrix3(Matrix3::NullaryExpr(
             [&](Eigen::Index, Eigen::Index) { return std::floor(r.uniform(-1.0, 2.0)); }));
       }},
      {"entries of very different size",
       [](Random& r) {
         return Matrix3(
             r.normal_matrix().unaryExpr([&](double x) { return x * r.power_of_ten(-20, 0); }));
       }},
      {"any scale",
       [](Random& r) { return Matrix3(r.normal_matrix() * r.power_of_ten(-150, 150)); }},
      {"denormal entries", [](Random& r) { return Matrix3(r.normal_matrix() * 1e-315); }},
      {"all entries huge but one",
       [](Random& r) {
         Matrix3 A = r.normal_matrix() * 1e300;
         A(r.below(3), r.below(3)) = r.normal() * 1e-300;
         return A;
       }},
  };
  return all;
}

/// A times an exact power of two, so that its largest entry lies in [1, 2) and no product under- or
/// overflows. The minimiser is the same.
Matrix3 scaled_to_one(const Matrix3& A) {
  const double largest = A.cwiseAbs().maxCoeff();
  if (!(largest > 0.0)) return A;
  const int exponent = std::ilogb(largest);
  return A.unaryExpr([exponent](double x) { return std::ldexp(x, -exponent); });
}

double value(const Matrix3& A, const Matrix3& X) { return (A * X).trace(); }

/// max |X^T X - I|, and 1 for a reflection or a NaN.
double distance_from_rotation(const Matrix3& X) {
  const double error = (X.transpose() * X - Matrix3::Identity()).cwiseAbs().maxCoeff();
  return X.allFinite() && X.determinant() > 0.0 ? error : 1.0;
}

}  // namespace

TEST_CASE("on a million matrices both kernels give rotations and agree in the objective") {
  Random random;
  INFO(random.replay());
  const int draws = 1000000 / static_cast<int>(families().size()) + 1;
  for (const Family& family : families()) {
    double worst_exact = 0.0, worst_fast = 0.0, worst_difference = 0.0;
    Matrix3 worst_A = Matrix3::Zero();
    for (int k = 0; k < draws; ++k) {
      const Matrix3 A = family.draw(random);
      const Matrix3 exact = loso(A), fast = loso_fast(A);
      worst_exact = std::max(worst_exact, distance_from_rotation(exact));
      worst_fast = std::max(worst_fast, distance_from_rotation(fast));
      const Matrix3 scaled = scaled_to_one(A);
      const double difference = std::abs(value(scaled, fast) - value(scaled, exact));
      if (difference > worst_difference * scaled.norm()) {
        worst_difference = difference / scaled.norm();
        worst_A = A;
      }
    }
    CAPTURE(family.name);
    CAPTURE(worst_A);
    CHECK(worst_exact <= 1e-14);
    CHECK(worst_fast <= 1e-14);
    CHECK(worst_difference <= 1e-12);
  }
}

TEST_CASE("the singular value decomposition is Eigen's, whatever the rank") {
  Random random;
  INFO(random.replay());
  const Matrix3 I = Matrix3::Identity();
  const int draws = 100000 / static_cast<int>(families().size()) + 1;
  for (const Family& family : families()) {
    double worst = 0.0;
    for (int k = 0; k < draws; ++k) {
      const Matrix3 A = scaled_to_one(family.draw(random));
      const rotavg::SingularValues svd = rotavg::singular_values(A);
      const Eigen::JacobiSVD<Matrix3> reference(A);
      worst =
          std::max({worst, (svd.d - reference.singularValues()).norm(),
                    (svd.U.transpose() * svd.U - I).norm(), (svd.V.transpose() * svd.V - I).norm(),
                    (svd.U * svd.d.asDiagonal() * svd.V.transpose() - A).norm()});
      if (!(worst < 1e-14)) break;  // not a number, too
    }
    CAPTURE(family.name);
    CHECK(worst < 1e-14);
  }
}

TEST_CASE("the minimum is that of Theorem 2, -(s1 + s2) + s3, or -(s1 + s2 + s3) for det A < 0") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 20000; ++k) {
    Vector3 s = {1.0, random.uniform(0, 1), random.power_of_ten(-18, 0)};
    std::sort(s.data(), s.data() + 3, std::greater<>());
    const double det_sign = sign(random);
    const Matrix3 A = det_sign * with_singular_values(random, s);
    const double minimum = -(s[0] + s[1]) + det_sign * s[2];
    CAPTURE(s);
    CAPTURE(det_sign);
    REQUIRE(value(A, loso(A)) == doctest::Approx(minimum).epsilon(1e-14));
    REQUIRE(value(A, loso_fast(A)) == doctest::Approx(minimum).epsilon(1e-12));
  }
}

TEST_CASE("the minimiser is V diag(-1, -1, 1) U^T for det U det V = 1 and -V U^T for -1") {
  Random random;
  INFO(random.replay());
  const Vector3 s(3.0, 2.0, 1.0);
  for (int k = 0; k < 1000; ++k) {
    const Matrix3 U = random.rotation(), V = random.rotation();
    const Matrix3 A = U * s.asDiagonal() * V.transpose();
    const Matrix3 same_sign = V * Vector3(-1.0, -1.0, 1.0).asDiagonal() * U.transpose();
    const Matrix3 opposite_sign = V * U.transpose();  // of -A = (-U) D V^T
    for (const auto kernel : {&loso, &loso_fast}) {
      REQUIRE((kernel(A) - same_sign).norm() < 1e-13);
      REQUIRE((kernel(-A) - opposite_sign).norm() < 1e-13);
    }
  }
}

TEST_CASE("no rotation that random search and descent find is better") {
  Random random;
  INFO(random.replay());
  for (const Family& family : families()) {
    for (int k = 0; k < 5; ++k) {
      const Matrix3 A = family.draw(random);
      const Matrix3 scaled = scaled_to_one(A);
      Matrix3 best = random.rotation();
      for (int trial = 0; trial < 2000; ++trial) {
        // First anywhere, then ever closer to the best so far.
        const double size = trial < 500 ? 3.0 : 3.0 * std::exp(-(trial - 500) / 60.0);
        const Matrix3 X =
            trial < 500 ? random.rotation() : rotavg::exp_so3(size * random.normal_vector()) * best;
        if (value(scaled, X) < value(scaled, best)) best = X;
      }
      CAPTURE(family.name);
      CAPTURE(A);
      CHECK(value(scaled, loso(A)) <= value(scaled, best) + 1e-14 * scaled.norm());
      CHECK(value(scaled, loso_fast(A)) <= value(scaled, best) + 1e-12 * scaled.norm());
      // The search is a fair opponent: it comes close.
      CHECK(value(scaled, loso(A)) >= value(scaled, best) - 1e-2 * scaled.norm());
    }
  }
}

TEST_CASE("zero, multiples of the identity and single entries of any scale give rotations") {
  constexpr double tiny = std::numeric_limits<double>::denorm_min();
  constexpr double huge = std::numeric_limits<double>::max();
  for (const double scale : {0.0, tiny, 1e-310, 1e-150, 1.0, 1e150, 1e308, huge}) {
    for (const double factor : {scale, -scale}) {
      std::vector<Matrix3> matrices = {factor * Matrix3::Identity(), Matrix3::Constant(factor),
                                       factor * Matrix3(Vector3(1, 1, -1).asDiagonal())};
      for (int entry = 0; entry < 9; ++entry) {
        matrices.emplace_back(Matrix3::Zero());
        matrices.back()(entry / 3, entry % 3) = factor;
      }
      for (const Matrix3& A : matrices) {
        CAPTURE(A);
        CHECK(distance_from_rotation(loso(A)) <= 1e-14);
        CHECK(distance_from_rotation(loso_fast(A)) <= 1e-14);
        const Matrix3 scaled = scaled_to_one(A);
        const double minimum = value(scaled, loso(A));
        CHECK(value(scaled, loso_fast(A)) == doctest::Approx(minimum).epsilon(1e-12));
      }
    }
  }
}

TEST_CASE("minus the identity gives the identity, which a kernel must not miss") {
  CHECK((loso(-Matrix3::Identity()) - Matrix3::Identity()).norm() < 1e-15);
  CHECK((loso_fast(-Matrix3::Identity()) - Matrix3::Identity()).norm() < 1e-15);
}

TEST_CASE("the rotation nearest to a rotation is itself") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10000; ++k) {
    const Matrix3 R = random.rotation();
    REQUIRE((nearest_rotation(R) - R).norm() < 2e-15);
  }
}

TEST_CASE("the nearest rotation turns along with its matrix, at any scale") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10000; ++k) {
    const Matrix3 M = with_singular_values(random, {3.0, 2.0, sign(random)});
    const Matrix3 P = random.rotation(), Q = random.rotation();
    const double scale = random.power_of_ten(-150, 150);
    const Matrix3 expected = P * nearest_rotation(M) * Q;
    REQUIRE((nearest_rotation(scale * (P * M * Q)) - expected).norm() < 1e-13);
  }
}

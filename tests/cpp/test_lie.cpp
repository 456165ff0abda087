#include <algorithm>
#include <cmath>

#include <doctest/doctest.h>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>

#include "support/random.hpp"

using rotavg::angle_between;
using rotavg::exp_so3;
using rotavg::hat;
using rotavg::log_so3;
using rotavg::Matrix3;
using rotavg::Vector3;
using rotavg::vee_difference;
using rotavg::test::Random;

namespace {

constexpr double pi = 3.141592653589793;

/// The exponential series of [w].
Matrix3 exp_by_series(const Vector3& w) {
  Matrix3 sum = Matrix3::Identity(), term = Matrix3::Identity();
  for (int k = 1; k < 60; ++k) {
    term = term * hat(w) / k;
    sum += term;
  }
  return sum;
}

}  // namespace

TEST_CASE("hat(w) x is the cross product, and vee_difference undoes it twice") {
  Random random;
  INFO(random.replay());
  const Vector3 w = random.normal_vector(), x = random.normal_vector();
  CHECK((hat(w) * x - w.cross(x)).norm() < 1e-15);
  CHECK((hat(w) + hat(w).transpose()).norm() == 0.0);
  CHECK((vee_difference(hat(w)) - 2.0 * w).norm() == 0.0);
  CHECK(vee_difference(Matrix3::Identity()).norm() == 0.0);
}

TEST_CASE("quaternions and small products are those of Eigen") {
  Random random;
  INFO(random.replay());
  constexpr double rounding = 1e-15;
  for (int k = 0; k < 3000; ++k) {
    // Near half turns about every axis, too: there the largest of the four is not w.
    const Vector3 axis = k % 2 == 0 ? random.direction() : Vector3(Vector3::Unit(k / 2 % 3));
    const double angle = k % 4 < 2 ? random.uniform(0.0, pi) : pi - random.power_of_ten(-12, -1);
    const Matrix3 R = exp_so3(angle * axis), S = random.rotation();
    const Vector3 a = random.normal_vector(), b = random.normal_vector();
    const Eigen::Quaterniond expected(R);
    const rotavg::Quaternion q(R);
    CAPTURE(angle);
    REQUIRE((q.coeffs() - expected.coeffs()).norm() < rounding);
    REQUIRE(q.norm() == doctest::Approx(expected.norm()).epsilon(rounding));
    REQUIRE((q.toRotationMatrix() - expected.toRotationMatrix()).norm() < 4.0 * rounding);
    REQUIRE((q.conjugate().coeffs() - expected.conjugate().coeffs()).norm() < rounding);
    const rotavg::Vector4 twice = 2.0 * q.coeffs();
    REQUIRE(
        (rotavg::Quaternion(twice).normalized().coeffs() - expected.normalized().coeffs()).norm() <
        rounding);
    REQUIRE((rotavg::product(R, S) - R * S).norm() < 4.0 * rounding);
    REQUIRE((rotavg::product(R, a) - R * a).norm() < 4.0 * rounding * a.norm());
    REQUIRE((rotavg::cross(a, b) - a.cross(b)).norm() < 4.0 * rounding * a.norm() * b.norm());
    REQUIRE((rotavg::unit(a) - a.normalized()).norm() < rounding);
    REQUIRE(rotavg::chordal_distance(R, S) == doctest::Approx((R - S).norm()).epsilon(1e-14));
  }
  const rotavg::Quaternion zero{rotavg::Vector4::Zero().eval()};
  CHECK(zero.normalized().norm() == 0.0);
}

TEST_CASE("exp is the exponential series") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 1000; ++k) {
    const Vector3 w = random.power_of_ten(-9, 0.7) * random.direction();
    CAPTURE(w.norm());
    REQUIRE((exp_so3(w) - exp_by_series(w)).norm() < 1e-13);
  }
}

TEST_CASE("exp gives a rotation for every length, many turns and denormal numbers too") {
  Random random;
  INFO(random.replay());
  for (int exponent = -320; exponent <= 15; ++exponent) {
    const Matrix3 R = exp_so3(std::pow(10.0, exponent) * random.direction());
    CAPTURE(exponent);
    REQUIRE((R.transpose() * R - Matrix3::Identity()).cwiseAbs().maxCoeff() < 1e-14);
    REQUIRE(R.determinant() > 0.0);
  }
  CHECK((exp_so3(Vector3::Zero()) - Matrix3::Identity()).norm() == 0.0);
}

TEST_CASE("log undoes exp to full relative accuracy from 1e-200 to nearly pi") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10000; ++k) {
    const double angle = std::min(random.power_of_ten(k % 2 == 0 ? -200 : -12, 0.5), pi - 1e-3);
    const Vector3 w = angle * random.direction();
    CAPTURE(angle);
    REQUIRE((log_so3(exp_so3(w)) - w).norm() <= 1e-12 * angle);
  }
}

TEST_CASE("exp undoes log around half turns, where the axis may flip") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10000; ++k) {
    const double angle = k % 10 == 0 ? pi : pi - random.power_of_ten(-16, -1);
    const Matrix3 R = exp_so3(angle * random.direction());
    const Vector3 w = log_so3(R);
    CAPTURE(angle);
    REQUIRE(w.norm() <= pi + 1e-14);
    REQUIRE((exp_so3(w) - R).norm() < 1e-14);
  }
}

TEST_CASE("log of an exact half turn about each axis has the length pi") {
  for (int axis = 0; axis < 3; ++axis) {
    Vector3 diagonal = Vector3::Constant(-1.0);
    diagonal[axis] = 1.0;
    const Vector3 w = log_so3(diagonal.asDiagonal());
    CHECK(std::abs(w[axis]) == doctest::Approx(pi).epsilon(1e-15));
    CHECK(w.norm() == doctest::Approx(pi).epsilon(1e-15));
  }
}

TEST_CASE("the angle between rotations is right for tiny angles, half turns and all between") {
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 10000; ++k) {
    const double angle = k % 2 == 0 ? random.power_of_ten(-100, -1) : random.uniform(0.0, pi);
    const Matrix3 B = exp_so3(angle * random.direction());
    CAPTURE(angle);
    REQUIRE(angle_between(Matrix3::Identity(), B) == doctest::Approx(angle).epsilon(1e-12));
    const Matrix3 A = random.rotation();
    REQUIRE(std::abs(angle_between(A, A * B) - angle) < 1e-14);
    REQUIRE(std::abs(angle_between(A * B, A) - angle) < 1e-14);
  }
  CHECK(angle_between(Matrix3::Identity(), Matrix3::Identity()) == 0.0);
}

TEST_CASE("the inverse right Jacobian is the derivative of the logarithm") {
  Random random;
  INFO(random.replay());
  constexpr double h = 1e-6;
  for (int k = 0; k < 300; ++k) {
    const double angle = k % 3 == 0 ? random.power_of_ten(-9, -1) : random.uniform(0.005, 3.1);
    const Vector3 r = angle * random.direction();
    const Matrix3 J = rotavg::inverse_right_jacobian(r);
    CAPTURE(angle);
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3 d = h * Vector3::Unit(axis);
      const Vector3 change = log_so3(exp_so3(r) * exp_so3(d)) - log_so3(exp_so3(r) * exp_so3(-d));
      REQUIRE((J.col(axis) - change / (2.0 * h)).norm() < 1e-8);
    }
  }
}

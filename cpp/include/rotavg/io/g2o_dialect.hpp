#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string_view>
#include <vector>

#include <rotavg/io/graph_file.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io::detail {

/// What lines look like.
struct G2oDialect {
  std::string_view vertex, edge;
  std::size_t dimension, num_pose, num_information;  // numbers of a position, a pose …
  std::array<std::size_t, 6> rotation_block;         // places of its upper triangle; the others' 0s

  Vector3 position(const double* pose) const {
    return {pose[0], pose[1], dimension == 3 ? pose[2] : 0.0};
  }
  WeightedQuaternion rotation(const double* pose) const {
    if (dimension == 3) return {pose[6], pose[3], pose[4], pose[5]};
    return {std::cos(0.5 * pose[2]), 0.0, 0.0, std::sin(0.5 * pose[2])};
  }
  /// The rotation's block of the information; in the plane a multiple of the identity.
  Matrix3 rotation_information(const double* values) const {
    if (dimension == 2) return multiple_of_identity(values[rotation_block[0]]);
    std::array<double, 6> v{};
    for (std::size_t k = 0; k < 6; ++k) v[k] = values[rotation_block[k]];
    Matrix3 omega;
    omega << v[0], v[1], v[2], v[1], v[3], v[4], v[2], v[4], v[5];
    return omega;
  }
  /// The translation's block of the information; in the plane z gets the mean of x and y.
  Matrix3 translation_information(const double* values) const {
    Matrix3 omega = Matrix3::Zero();
    for (Eigen::Index r = 0, k = 0; r < static_cast<Eigen::Index>(dimension); ++r) {
      for (Eigen::Index c = r; c < static_cast<Eigen::Index>(dimension + num_turn()); ++c, ++k) {
        if (c < static_cast<Eigen::Index>(dimension)) omega(r, c) = omega(c, r) = values[k];
      }
    }
    if (dimension == 2) omega(2, 2) = 0.5 * (omega(0, 0) + omega(1, 1));
    return omega;
  }
  /// Degrees of freedom of a rotation.
  std::size_t num_turn() const { return dimension == 3 ? 3 : 1; }
  /// Appends the numbers of a rotation.
  void write(const Matrix3& R, std::vector<double>& pose) const {
    if (dimension == 2) {
      pose.push_back(std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1)));
      return;
    }
    const Vector4 q = written_quaternion(WeightedQuaternion(R));
    pose.insert(pose.end(), {q(0), q(1), q(2), q(3)});
  }
};
inline constexpr std::array<G2oDialect, 2> g2o_dialects{
    G2oDialect{"VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", 3, 7, 21, {15, 16, 17, 18, 19, 20}},
    G2oDialect{"VERTEX_SE2", "EDGE_SE2", 2, 3, 6, {5, 0, 0, 0, 0, 0}}};

/// kappa of rotation information; NaN where that is not positive definite.
inline double concentration(const Matrix3& omega) {
  double scale = 0.0;
  for (int k = 0; k < 9; ++k) scale = std::max(scale, std::abs(omega(k)));
  const double a = omega(0, 0) / scale, b = omega(0, 1) / scale, c = omega(0, 2) / scale;
  const double d = omega(1, 1) / scale, e = omega(1, 2) / scale, f = omega(2, 2) / scale;
  const double ad = a * d - b * b, af = a * f - c * c, df = d * f - e * e;  // minors
  const double det = a * df - b * (b * f - c * e) + c * (b * e - c * d);
  const bool definite = a > 0.0 && ad > 0.0 && det > 0.0;
  return definite ? 1.5 * scale * det / (ad + af + df) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace rotavg::io::detail

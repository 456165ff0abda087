#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// A = U diag(d) V^T with orthogonal U and V, d falling and not negative.
struct SingularValues {
  Matrix3 U;
  Vector3 d;
  Matrix3 V;
};

/// The singular value decomposition of a 3 x 3 matrix by rotations of its columns (Hestenes 1958):
/// A V has orthogonal columns, d their lengths. Of a matrix without rank the columns of U that A
/// leaves open complete the others.
///
/// @param A finite, its largest entry of a size near 1, so that no square overflows
inline SingularValues singular_values(const Matrix3& A) {
  constexpr int max_sweeps = 30;  // some six are needed
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  Matrix3 W = A, V = Matrix3::Identity();
  const auto dot = [&](int p, int q) {
    return W(0, p) * W(0, q) + W(1, p) * W(1, q) + W(2, p) * W(2, q);
  };

  bool orthogonal = false;
  for (int sweep = 0; sweep < max_sweeps && !orthogonal; ++sweep) {
    orthogonal = true;
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        const double pp = dot(p, p), qq = dot(q, q), pq = dot(p, q);
        if (std::abs(pq) <= epsilon * std::sqrt(pp) * std::sqrt(qq)) continue;
        orthogonal = false;
        // tan of the smaller angle that makes them orthogonal
        const double zeta = 0.5 * (qq - pp) / pq;
        const double t = (zeta < 0.0 ? -1.0 : 1.0) / (std::abs(zeta) + std::hypot(1.0, zeta));
        const double c = 1.0 / std::hypot(1.0, t), s = c * t;
        for (Matrix3* M : {&W, &V}) {
          for (int r = 0; r < 3; ++r) {
            const double x = (*M)(r, p), y = (*M)(r, q);
            (*M)(r, p) = c * x - s * y;
            (*M)(r, q) = s * x + c * y;
          }
        }
      }
    }
  }

  int order[3] = {0, 1, 2};
  const double squares[3] = {dot(0, 0), dot(1, 1), dot(2, 2)};
  std::sort(order, order + 3, [&](int a, int b) { return squares[a] > squares[b]; });
  SingularValues svd;
  Vector3 w[3];  // the columns of A V
  for (int k = 0; k < 3; ++k) {
    svd.d(k) = std::sqrt(squares[order[k]]);
    for (int r = 0; r < 3; ++r) {
      svd.V(r, k) = V(r, order[k]);
      w[k](r) = W(r, order[k]);
    }
  }

  // u_1 = w_1 / |w_1|; u_2 is w_2 made orthogonal to it, or where w_2 vanishes, the axis that is
  // the least along u_1; u_3 is orthogonal to both, on the side of w_3.
  Vector3 u[3] = {Vector3(1.0, 0.0, 0.0), w[1], {}};
  if (svd.d(0) > 0.0) u[0] = w[0] / svd.d(0);
  if (!(svd.d(1) > std::numeric_limits<double>::min())) {
    int least = 0;
    for (int k = 1; k < 3; ++k) least = std::abs(u[0](k)) < std::abs(u[0](least)) ? k : least;
    u[1] = Vector3(0.0, 0.0, 0.0);
    u[1](least) = 1.0;
  } else {
    u[1] = w[1] / svd.d(1);
  }
  u[1] -= u[0].dot(u[1]) * u[0];
  u[1] = u[1] / u[1].norm();
  u[2] = cross(u[0], u[1]);
  if (u[2].dot(w[2]) < 0.0) u[2] *= -1.0;
  for (int k = 0; k < 3; ++k) {
    for (int r = 0; r < 3; ++r) svd.U(r, k) = u[k](r);
  }
  return svd;
}

}  // namespace rotavg

#pragma once

#include <cmath>

#include <rotavg/types.hpp>

namespace rotavg {

// Products of 3 x 3 matrices as plain loops. An expression of Eigen's is a chain of types, and
// every further form of one costs a compiler some 20 ms and 2 MB; these cost nothing, however often
// used.

/// A B. The last row is added up in another order than the others: so it is in Eigen's product,
/// whose bits these are.
inline Matrix3 product(const Matrix3& A, const Matrix3& B) {
  Matrix3 C;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 2; ++r) {
      C(r, c) = A(r, 0) * B(0, c) + A(r, 1) * B(1, c) + A(r, 2) * B(2, c);
    }
    C(2, c) = A(2, 0) * B(0, c) + (A(2, 1) * B(1, c) + A(2, 2) * B(2, c));
  }
  return C;
}

/// A^T B.
inline Matrix3 transposed_product(const Matrix3& A, const Matrix3& B) {
  Matrix3 C;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) {
      C(r, c) = A(0, r) * B(0, c) + A(1, r) * B(1, c) + A(2, r) * B(2, c);
    }
  }
  return C;
}

/// A B^T.
inline Matrix3 product_transposed(const Matrix3& A, const Matrix3& B) {
  Matrix3 C;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) {
      C(r, c) = A(r, 0) * B(c, 0) + A(r, 1) * B(c, 1) + A(r, 2) * B(c, 2);
    }
  }
  return C;
}

/// A x, added up in the same order.
inline Vector3 product(const Matrix3& A, const Vector3& x) {
  Vector3 y;
  for (int r = 0; r < 2; ++r) y(r) = A(r, 0) * x(0) + A(r, 1) * x(1) + A(r, 2) * x(2);
  y(2) = A(2, 0) * x(0) + (A(2, 1) * x(1) + A(2, 2) * x(2));
  return y;
}

/// A^T.
inline Matrix3 transposed(const Matrix3& A) {
  Matrix3 T;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) T(r, c) = A(c, r);
  }
  return T;
}

inline double dot(const Vector3& a, const Vector3& b) {
  return a(0) * b(0) + a(1) * b(1) + a(2) * b(2);
}

/// a / |a|.
inline Vector3 unit(const Vector3& a) {
  const double length = std::sqrt(dot(a, a));
  return {a(0) / length, a(1) / length, a(2) / length};
}

/// a x b.
inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a(1) * b(2) - a(2) * b(1), a(2) * b(0) - a(0) * b(2), a(0) * b(1) - a(1) * b(0)};
}

/// a b^T.
inline Matrix3 outer_product(const Vector3& a, const Vector3& b) {
  Matrix3 C;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) C(r, c) = a(r) * b(c);
  }
  return C;
}

/// (A + A^T) / 2.
inline Matrix3 symmetric_part(const Matrix3& A) {
  Matrix3 S;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) S(r, c) = 0.5 * (A(r, c) + A(c, r));
  }
  return S;
}

/// A <- A + B.
inline void add(Matrix3& A, const Matrix3& B) {
  for (int k = 0; k < 9; ++k) A(k) += B(k);
}

/// A <- A + x I.
inline void add_to_diagonal(Matrix3& A, double x) {
  for (int k = 0; k < 3; ++k) A(k, k) += x;
}

/// |A - B|_F.
inline double chordal_distance(const Matrix3& A, const Matrix3& B) {
  double squares = 0.0;
  for (int k = 0; k < 9; ++k) squares += (A(k) - B(k)) * (A(k) - B(k));
  return std::sqrt(squares);
}

inline bool is_finite(const Vector3& a) {
  return std::isfinite(a(0)) && std::isfinite(a(1)) && std::isfinite(a(2));
}
inline bool is_finite(const Matrix3& A) {
  for (int k = 0; k < 9; ++k) {
    if (!std::isfinite(A(k))) return false;
  }
  return true;
}

/// x I.
inline Matrix3 multiple_of_identity(double x) {
  Matrix3 A = Matrix3::Zero();
  add_to_diagonal(A, x);
  return A;
}

inline double determinant(const Matrix3& A) {
  return A(0, 0) * (A(1, 1) * A(2, 2) - A(1, 2) * A(2, 1)) +
         A(0, 1) * (A(1, 2) * A(2, 0) - A(1, 0) * A(2, 2)) +
         A(0, 2) * (A(1, 0) * A(2, 1) - A(1, 1) * A(2, 0));
}

/// det(A) A^-1.
inline Matrix3 adjugate(const Matrix3& A) {
  const Vector3 a = A.col(0), b = A.col(1), c = A.col(2);
  const Vector3 rows[3] = {cross(b, c), cross(c, a), cross(a, b)};
  Matrix3 adjugate;
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) adjugate(r, k) = rows[r](k);
  }
  return adjugate;
}

}  // namespace rotavg

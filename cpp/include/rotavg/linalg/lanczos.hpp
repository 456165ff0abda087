#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/flat.hpp>

namespace rotavg {

/// The smallest eigenvalue of a symmetric tridiagonal matrix and, of its unit eigenvector, the last
/// entry: bisection with Sturm's sequences, then inverse iteration (Golub and Van Loan, 8.4).
struct TridiagonalEigen {
  double value = 0.0;
  double last_entry = 0.0;
};

/// @param diagonal k entries
/// @param beside k - 1 entries, none of them zero
inline TridiagonalEigen smallest_tridiagonal_eigen(const std::vector<double>& diagonal,
                                                   const std::vector<double>& beside) {
  const std::size_t k = diagonal.size();
  double low = diagonal[0], high = diagonal[0];  // Gershgorin; and any diagonal entry is above
  for (std::size_t a = 0; a < k; ++a) {
    const double radius =
        (a > 0 ? std::abs(beside[a - 1]) : 0.0) + (a + 1 < k ? std::abs(beside[a]) : 0.0);
    low = std::min(low, diagonal[a] - radius);
    high = std::min(high, diagonal[a]);
  }
  const double scale = std::max(std::abs(low), std::abs(high));
  const auto is_below_all = [&](double x) {  // the pivots of T - x are positive
    double pivot = diagonal[0] - x;
    for (std::size_t a = 1; a < k && pivot > 0.0; ++a) {
      pivot = diagonal[a] - x - beside[a - 1] * beside[a - 1] / pivot;
    }
    return pivot > 0.0;
  };
  low -= 1e-15 * scale;
  while (high - low > 1e-14 * scale) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    (is_below_all(middle) ? low : high) = middle;
  }
  // Two steps of inverse iteration with T - low, which is positive definite.
  std::vector<double> pivot(k), x(k, 1.0);
  pivot[0] = diagonal[0] - low;
  for (std::size_t a = 1; a < k; ++a) {
    pivot[a] = diagonal[a] - low - beside[a - 1] * beside[a - 1] / pivot[a - 1];
    if (!(pivot[a] > 0.0)) pivot[a] = 1e-16 * scale;
  }
  for (int step = 0; step < 2; ++step) {
    for (std::size_t a = 1; a < k; ++a) x[a] -= beside[a - 1] / pivot[a - 1] * x[a - 1];
    for (std::size_t a = 0; a < k; ++a) x[a] /= pivot[a];
    for (std::size_t a = k - 1; a-- > 0;) x[a] -= beside[a] / pivot[a] * x[a + 1];
    double norm = 0.0;
    for (const double entry : x) norm = std::hypot(norm, entry);
    for (double& entry : x) entry /= norm;
  }
  return {0.5 * (low + high), x.back()};
}

struct RitzValue {
  double value = 0.0;     ///< not below the smallest eigenvalue, but for rounding
  double residual = 0.0;  ///< some eigenvalue is this close
  bool converged = false;
};

struct LanczosOptions {
  double relative_tolerance = 0.1;  ///< stop at residual <= relative_tolerance |value|
  int min_iterations = 20;          ///< a start may look converged by accident
  int max_iterations = 1000;
  double enough = -std::numeric_limits<double>::infinity();  ///< stop where the value is below
  int num_threads = 1;
  std::function<bool()> keep_going;  ///< asked every iteration; false stops
};

/// The smallest eigenvalue of a symmetric operator by Lanczos' method (Lanczos 1950), without
/// storing the basis: extreme eigenvalues do not suffer from lost orthogonality (Paige 1971).
///
/// @param apply `Eigen::VectorXd apply(const Eigen::VectorXd&)`
/// @param project `void project(Eigen::VectorXd&)`, onto the space where the search is to stay;
///        asked last of all, as rounding is much of a short vector
/// @param start not zero, in that space
template <typename Operator, typename Projection>
RitzValue smallest_ritz_value(Operator&& apply, Projection&& project, Eigen::VectorXd start,
                              const LanczosOptions& options) {
  constexpr int between_checks = 5;
  const int num_threads = options.num_threads;
  RitzValue result;
  std::vector<double> diagonal, beside;
  Eigen::VectorXd q = start / start.norm(), last = Eigen::VectorXd::Zero(q.size());
  double scale = 0.0;
  while (static_cast<int>(diagonal.size()) < options.max_iterations) {
    if (options.keep_going && !options.keep_going()) break;
    Eigen::VectorXd next = apply(q);
    const double a = flat_dot(q, next, num_threads);
    flat_combine(1.0, next, -a, q, num_threads);
    if (!beside.empty()) flat_combine(1.0, next, -beside.back(), last, num_threads);
    project(next);
    const double b = std::sqrt(flat_dot(next, next, num_threads));
    diagonal.push_back(a);
    scale = std::max(scale, std::abs(a) + b);
    const bool exhausted = !(b > 1e-14 * scale);
    const int size = static_cast<int>(diagonal.size());
    const bool ends = exhausted || size == options.max_iterations;
    if (ends || (size >= options.min_iterations && size % between_checks == 0)) {
      const TridiagonalEigen eigen = smallest_tridiagonal_eigen(diagonal, beside);
      result.value = eigen.value;
      result.residual = std::abs(b * eigen.last_entry);
      result.converged = result.residual <= options.relative_tolerance * std::abs(result.value);
      if (result.converged || exhausted || result.value < options.enough) break;
    }
    beside.push_back(b);
    last.swap(q);
    q.swap(next);
    flat_combine(1.0 / b, q, 0.0, q, num_threads);
  }
  return result;
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How residuals are distributed: the noise as Student's t distribution in some dimensions, and
/// beside it rotations drawn at random. The maximum of the likelihood (by expectation maximisation;
/// Kent, Tyler and Vardi 1994) for some degrees of freedom, the best of which are taken.
struct Tails {
  int space = 3;         ///< dimensions of what rotations are possible: 1 of those about one axis
  int dimension = 3;     ///< of the noise; 1: its angle is like half of a distribution on a line
  double freedom = 1.0;  ///< degrees of freedom: from 8 or so on hardly other than a normal one
  double sigma = 0.0;    ///< of every direction near zero, radians: of an edge of precision 1
  double random = 0.0;   ///< share of the edges that are drawn at random
  double log_likelihood = -std::numeric_limits<double>::infinity();

  /// Whether the noise is like a normal one: then least squares are the best on the inliers.
  bool are_normal() const { return dimension == space && freedom >= 8.0; }

  /// From this residual on an edge is likelier to be drawn at random than to be one of the noise;
  /// infinity: from none.
  double random_beyond() const;

  /// Of so many residuals of the noise hardly one is beyond this, in one case of ten.
  double reach(std::size_t count) const;
};

namespace detail {

/// The density of the residual r of noise, over r^(d - 1) (1 + r^2 / (nu sigma^2))^(-(nu + d) / 2).
inline double noise_factor(const Tails& tails) {
  constexpr double pi = 3.141592653589793;
  const double d = tails.dimension, nu = tails.freedom;
  const double log_t = std::lgamma(0.5 * (nu + d)) - std::lgamma(0.5 * nu) -
                       0.5 * d * std::log(nu * pi) - d * std::log(tails.sigma);
  return (tails.dimension == 1 ? 2.0 : 4.0 * pi) * std::exp(log_t);
}

/// The same of noise, and that of rotations drawn at random (Haar's measure, at small angles).
inline double noise_density(const Tails& tails, double factor, double x) {
  const double d = tails.dimension, nu = tails.freedom;
  const double bend = std::pow(1.0 + x / (nu * tails.sigma * tails.sigma), -0.5 * (nu + d));
  return factor * (tails.dimension == 1 ? 1.0 : x) * bend;
}
inline double random_density(int space, double x) {
  constexpr double pi = 3.141592653589793;
  return space == 1 ? 1.0 / pi : x / (2.0 * pi);
}

/// Numbers of residuals by their logarithm: as good as themselves, and few.
struct ResidualCounts {
  std::vector<double> squared, count;
};

inline ResidualCounts counted(const std::vector<double>& x, double noise) {
  constexpr double width = 0.2;               // of ln x, 10 % of a residual
  constexpr double least = 1e-4, bins = 140;  // below a hundredth of the noise none is told
  const double first = std::log(least * noise * noise);
  std::vector<double> sum(static_cast<std::size_t>(bins), 0.0), count(sum);
  for (const double x_k : x) {
    const double at = (std::log(std::max(x_k, least * noise * noise)) - first) / width;
    const auto b = static_cast<std::size_t>(std::min(at, bins - 1.0));
    sum[b] += std::max(x_k, least * noise * noise);
    count[b] += 1.0;
  }
  ResidualCounts counts;
  for (std::size_t b = 0; b < count.size(); ++b) {
    if (count[b] == 0.0) continue;
    counts.squared.push_back(sum[b] / count[b]);
    counts.count.push_back(count[b]);
  }
  return counts;
}

/// Improves sigma and the random share for given degrees of freedom.
inline void improve(const ResidualCounts& counts, int steps, Tails& tails) {
  constexpr double tiny = 1e-300;
  const double d = tails.dimension, nu = tails.freedom;
  for (int step = 0; step <= steps; ++step) {
    const double variance = tails.sigma * tails.sigma, factor = noise_factor(tails);
    double total = 0.0, noisy = 0.0, weights = 0.0, squares = 0.0;
    tails.log_likelihood = 0.0;
    for (std::size_t b = 0; b < counts.count.size(); ++b) {
      const double x = counts.squared[b], count = counts.count[b];
      const double of_noise = (1.0 - tails.random) * noise_density(tails, factor, x);
      const double density =
          std::max(tiny, of_noise + tails.random * random_density(tails.space, x));
      tails.log_likelihood += count * std::log(density);
      const double q = count * of_noise / density;
      const double weight = q * (nu + d) / (nu + x / variance);
      total += count;
      noisy += q;
      weights += weight;
      squares += weight * x;
    }
    if (step == steps || !(weights > 0.0)) break;
    tails.sigma = std::sqrt(squares / (d * weights));
    tails.random = std::clamp(1.0 - noisy / total, 0.0, 1.0);
  }
}

}  // namespace detail

inline double Tails::random_beyond() const {
  constexpr double most = 3.2;
  const double factor = detail::noise_factor(*this);
  const auto is_noise = [&](double r) {
    return (1.0 - random) * detail::noise_density(*this, factor, r * r) >
           random * detail::random_density(space, r * r);
  };
  if (is_noise(most)) return std::numeric_limits<double>::infinity();
  double below = 0.0, above = most;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (below + above);
    (is_noise(middle) ? below : above) = middle;
  }
  return above;
}

inline double Tails::reach(std::size_t count) const {
  constexpr double far = 1e6, width = 0.02, share = 0.1;  // of sigma; of ln r; of all cases
  const double factor = detail::noise_factor(*this);
  const double most = share / static_cast<double>(std::max<std::size_t>(count, 1));
  double r = far * sigma, beyond = 0.0;
  for (; r > sigma && beyond < most; r *= 1.0 - width) {
    beyond += width * r * detail::noise_density(*this, factor, r * r);
  }
  return r;
}

/// noise_scale() takes angles for half of a normal distribution; of a normal vector with three
/// components it finds so many times the standard deviation of one.
inline double noise_per_axis(int dimension) { return dimension == 1 ? 1.0 : 2.29; }

/// @param x squared residuals, in units of their precision
/// @param noise their estimated standard deviation, radians (noise_scale): where to begin
inline Tails residual_tails(const std::vector<double>& x, double noise, int dimension, int space) {
  constexpr std::array<double, 12> freedoms{32.0, 16.0, 11.0, 8.0, 5.6, 4.0,
                                            2.8,  2.0,  1.4,  1.0, 0.7, 0.5};
  constexpr double some = 0.02;  // heavy tails leave none, and from none there is no way back
  constexpr int steps = 12;
  const detail::ResidualCounts counts = detail::counted(x, noise);
  Tails tails, best;
  tails.space = space;
  tails.dimension = dimension;
  tails.sigma = noise / noise_per_axis(dimension);
  for (const double freedom : freedoms) {
    tails.freedom = freedom;
    tails.random = std::max(tails.random, some);
    detail::improve(counts, steps, tails);
    if (tails.log_likelihood > best.log_likelihood) best = tails;
  }
  return best;
}

/// Of the dimensions that the noise can have, the likelier.
inline Tails residual_tails(const std::vector<double>& x, double noise, int space) {
  const Tails on_line = residual_tails(x, noise, 1, space);
  if (space == 1) return on_line;
  const Tails in_space = residual_tails(x, noise, 3, space);
  return on_line.log_likelihood > in_space.log_likelihood ? on_line : in_space;
}

/// Whether all relative rotations are about one axis, to rounding.
inline bool turns_about_one_axis(const MeasurementGraph& graph) {
  constexpr double rounding = 1e-12;
  Vector3 axis = Vector3::Zero();
  for (const Edge& e : graph.edges()) {
    const Vector3 v(e.quaternion.x(), e.quaternion.y(), e.quaternion.z());
    if (v.squaredNorm() < rounding) continue;
    if (axis.isZero(0.0)) axis = v.normalized();
    const double along = axis.dot(v);
    if (v.squaredNorm() - along * along > rounding) return false;
  }
  return true;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace rotavg {

/// Losses of a residual r = 2 sin(angle / 2), the chord of the residual angle: within 1 % of the
/// angle in radians up to 28 degrees, at most 2, and r^2 = |R_i R_ij - R_j|_F^2 / 2, so that no
/// inverse trigonometric function is ever taken.
enum class Loss {
  l2,             ///< r^2: the objective (3); the only one that can be proved
  huber,          ///< quadratic, linear beyond the scale; convex in r
  l1,             ///< linear, rounded off below the scale
  l_half,         ///< the square root of r, rounded off below the scale (Chatterjee, Govindu 2018)
  cauchy,         ///< the logarithm of 1 + r^2 / scale^2
  geman_mcclure,  ///< bounded, smooth
  tls,            ///< truncated least squares: r^2, constant beyond the scale
  automatic,      ///< the robust choice for data with outliers
};

/// A loss with its scale c, as functions of x = r^2:
///
///     l2               x                                weight  1
///     huber            x, 2 c r - c^2 beyond c                  1, c / r beyond c
///     l1               2 c^2 ((1 + x / c^2)^(1/2) - 1)          (1 + x / c^2)^(-1/2)
///     l_half           4 c^2 ((1 + x / c^2)^(1/4) - 1)          (1 + x / c^2)^(-3/4)
///     cauchy           c^2 log(1 + x / c^2)                     (1 + x / c^2)^(-1)
///     geman_mcclure    x / (1 + x / c^2)                        (1 + x / c^2)^(-2)
///     tls              x, c^2 beyond c                          1, 0 beyond c
///
/// All are x near zero, so that they are comparable with (3), and concave in x. The weight, d rho /
/// d x = rho'(r) / (2 r), therefore makes w r^2 + const an upper bound of rho that touches it at r:
/// least squares with these weights lower the loss (Holland and Welsch 1977).
struct RobustLoss {
  Loss kind = Loss::l2;
  double scale = 1.0;  ///< c, a chord: radians for small angles
  /// Graduated non-convexity (Black and Rangarajan 1996; Yang, Antonante, Tzoumas and Carlone
  /// 2020): of tls, the surrogate with this mu; infinity is tls itself. (That of Geman and
  /// McClure is the loss itself with another scale.)
  double mu = std::numeric_limits<double>::infinity();

  double rho(double x) const {
    const double c2 = scale * scale, z = x * (1.0 / c2);
    switch (kind) {
      case Loss::huber:
        return x <= c2 ? x : 2.0 * scale * std::sqrt(x) - c2;
      case Loss::l1: {
        const double root = std::sqrt(1.0 + z);
        return 2.0 * x / (1.0 + root);
      }
      case Loss::l_half: {
        const double root = std::sqrt(1.0 + z);
        return 4.0 * x / ((1.0 + root) * (1.0 + std::sqrt(root)));
      }
      case Loss::cauchy:
        return c2 * (z < 0.01 ? std::log1p(z) : std::log(1.0 + z));  // log is the faster
      case Loss::geman_mcclure:
        return x / (1.0 + z);
      case Loss::tls: {
        if (x <= inner() * c2) return x;
        if (!(x < outer() * c2)) return c2;
        return 2.0 * scale * std::sqrt(x * mu * (mu + 1.0)) - mu * (c2 + x);
      }
      case Loss::l2:
      case Loss::automatic:
        break;
    }
    return x;
  }

  /// d rho / d x, from 1 down to 0.
  double weight(double x) const {
    const double z = x * (1.0 / (scale * scale));  // which a loop computes once
    switch (kind) {
      case Loss::huber:
        return z <= 1.0 ? 1.0 : 1.0 / std::sqrt(z);
      case Loss::l1:
        return 1.0 / std::sqrt(1.0 + z);
      case Loss::l_half: {
        const double root = std::sqrt(1.0 + z);
        return 1.0 / (root * std::sqrt(root));
      }
      case Loss::cauchy:
        return 1.0 / (1.0 + z);
      case Loss::geman_mcclure:
        return 1.0 / ((1.0 + z) * (1.0 + z));
      case Loss::tls:
        if (z <= inner()) return 1.0;
        if (!(z < outer())) return 0.0;
        return std::sqrt(mu * (mu + 1.0) / z) - mu;
      case Loss::l2:
      case Loss::automatic:
        break;
    }
    return 1.0;
  }

  /// Of an edge whose residuals are judged in units of its own, 1 / sqrt(precision): its scale is
  /// c / sqrt(precision). With a precision of zero it is x, as of least squares.
  double rho(double x, double precision) const {
    return precision > 0.0 ? rho(precision * x) / precision : x;
  }
  double weight(double x, double precision) const { return weight(precision * x); }

 private:
  /// Up to here, in x / c^2, the surrogate of tls is x, and from there on c^2.
  double inner() const { return std::isinf(mu) ? 1.0 : mu / (mu + 1.0); }
  double outer() const { return std::isinf(mu) ? 1.0 : (mu + 1.0) / mu; }
};

/// Whether a scale that was given, radians, is one.
inline bool is_loss_scale(double scale) {
  constexpr double least = 1e-6, pi = 3.141592653589793;
  return scale >= least && scale <= pi;
}

/// Of edge k, where an empty vector stands for precisions of 1.
inline double precision_of(const std::vector<double>& precision, std::size_t k) {
  return precision.empty() ? 1.0 : precision[k];
}

/// The share of every weight that no robust loss takes away, at most: an edge that it distrusts
/// altogether keeps this much, so that a graph stays connected and the weighted problem well posed.
constexpr double least_weight_share = 1e-6;

/// The same of one edge. Where the scale of the loss is small, all outliers together would pull
/// with this share harder than the loss lets them; so it goes down with the square of the scale.
inline double least_share(const RobustLoss& loss, double precision) {
  constexpr double part = 0.01, least = 1e-9;
  const double share =
      std::max(least, std::min(least_weight_share, part * loss.scale * loss.scale));
  return share / std::max(1.0, precision);
}

/// What a loss leaves of the weight of an edge with the squared residual x: (1 - s) d rho / d x +
/// s, with s its least share.
inline double weight_share(const RobustLoss& loss, double x, double precision) {
  const double s = least_share(loss, precision);
  return (1.0 - s) * loss.weight(x, precision) + s;
}

/// What the squared residual costs: (1 - s) rho + s x.
inline double robust_cost(const RobustLoss& loss, double x, double precision) {
  const double s = least_share(loss, precision);
  return (1.0 - s) * loss.rho(x, precision) + s * x;
}

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/certify/bound.hpp>

namespace rotavg {

enum class Verdict {
  not_run,
  proved,         ///< the gap is below the tolerance, by a proof (see failure_probability)
  estimated,      ///< the gap is below the tolerance, by an eigenvalue estimate
  not_certified,  ///< the gap is above the tolerance, or unknown
};

/// What keeps a certificate from the tolerance.
enum class Shortfall {
  none,
  leftover,    ///< S is positive: R is near the optimum, steps towards it or less rounding would do
  negative,    ///< S has a negative eigenvalue: R is not the optimum, or the relaxation not tight
  relaxation,  ///< the gap is the distance to the optimum of the relaxation, which was met
  undecided,   ///< nothing was proved, nor refuted
  stopped,     ///< by keep_going, before anything was, or before the gap was found
};

/// How far the objective at R can be from the global optimum (Theorem 1, and beyond it for points
/// that are not quite stationary), in one component or over all.
struct ComponentCertificate {
  Verdict verdict = Verdict::not_run;
  CertificateMethod method = CertificateMethod::none;
  /// Smallest eigenvalue of S = Lambda - Rt, Lambda symmetrised; zero to rounding at the optimum.
  /// Where S is not positive, and large, what an iteration has come down to: not less than it.
  /// Where a large factor was not kept, -gap / n, which is not above it to first order. NaN where
  /// it is not known: the work was stopped, the iteration did not converge, or such a gap is too
  /// large.
  double lambda_min = 0.0;
  /// f(R) - f* <= gap.
  double gap = std::numeric_limits<double>::infinity();
  /// gap / max(f, 1e-20 sum w). Below a root mean square residual of 1e-10 rad the criterion is
  /// absolute: the measurements themselves are rounded. (Of the w: counted_weight.)
  double relative_gap = std::numeric_limits<double>::infinity();
  /// The chance that the proof is wrong: zero of all but CertificateMethod::random_start. Of
  /// several components, their sum.
  double failure_probability = 0.0;
  Shortfall shortfall = Shortfall::none;  ///< of several components, of the worst
};

/// The certificate of a graph: the gap over all components, and for all else the worst of them.
struct Certificate : ComponentCertificate {
  std::vector<ComponentCertificate> components;  ///< in their order
};

namespace detail {

/// Of the sum of weights: an objective that is 1e-6 of this, with residuals of 1e-13 rad, is zero
/// to the rounding of measurements and rotations.
constexpr double objective_floor = 1e-20;

/// No edge counts for more than so many times the lightest (Measure::weight), ...
constexpr double most_of_lightest = 1000.0;

/// ... but for so much of its weight: what rounding alone takes of its part of f(R), which is some
/// 1e-29 of the weight (objective_rounding), is then within 1e-6 of the floor. Up to so many times
/// the lightest: beyond them, that rounding hides what light edges say.
constexpr double least_that_counts = 0.005, most_that_counts = 1e18;

/// What an edge of this weight counts for in Measure::weight.
inline double counted_weight(double weight, double lightest) {
  return std::max(std::min(weight, most_of_lightest * lightest),
                  least_that_counts * std::min(weight, most_that_counts * lightest));
}

/// What the gap of one component is held against.
struct Measure {
  double objective = 0.0;  ///< its part of f(R), plus what rounding can have taken away
  double constant = 0.0;   ///< what gravity's edges cost at any R, and is not in the objective
  /// Sum of w as they are counted: or a few heavy edges would hide all that the others say.
  double weight = 0.0;
  double total_weight = 0.0, num_edges = 0.0;
  double lightest = std::numeric_limits<double>::infinity();  ///< if it was looked for

  Measure& operator+=(const Measure& other) {
    objective += other.objective;
    constant += other.constant;
    total_weight += other.total_weight;
    num_edges += other.num_edges;
    lightest = std::min(lightest, other.lightest);
    return *this;
  }

  /// What a gap is relative to; NaN where the objective is.
  double scale() const {
    const double floor = objective_floor * weight;
    return objective < floor ? floor : objective;
  }
  double relative(double gap) const { return gap / scale(); }
  /// The mean square of the residuals, as good as.
  double noise() const { return (objective + constant) / total_weight; }
};

/// The larger of two numbers; NaN if one of them is.
inline double larger(double a, double b) { return std::isnan(a) || b <= a ? a : b; }

inline Verdict verdict_of(const ComponentCertificate& certificate, double tolerance) {
  if (!(certificate.relative_gap <= tolerance)) return Verdict::not_certified;
  return certificate.method == CertificateMethod::eigenvalue ? Verdict::estimated : Verdict::proved;
}

/// @param bound what S at R says
/// @param known what is known besides: f* is not below it
inline ComponentCertificate certify_component(const ComponentBound& bound, const LowerBound& known,
                                              const Measure& measure, double tolerance) {
  ComponentCertificate certificate;
  certificate.method = bound.method;
  certificate.gap = bound.gap;
  certificate.lambda_min = bound.lambda_min > 0.0 ? 0.0 : bound.lambda_min;  // as N^T S N = 0
  certificate.failure_probability = bound.failure_probability;
  const double least = std::max(0.0, known.value - measure.constant);
  const double gap = measure.objective - least;
  // A known bound is the better proof where it leaves nothing to gain.
  const bool nothing_left = measure.relative(gap) <= tolerance && known.method < bound.method;
  if (nothing_left || !(bound.gap < gap)) certificate.gap = gap;
  if (nothing_left || (least > 0.0 && !(bound.gap < gap))) certificate.method = known.method;
  if (certificate.method != bound.method) certificate.failure_probability = 0.0;
  certificate.relative_gap = measure.relative(certificate.gap);
  certificate.verdict = verdict_of(certificate, tolerance);
  if (certificate.verdict == Verdict::not_certified) {
    certificate.shortfall = certificate.method == CertificateMethod::relaxation && known.is_optimum
                                ? Shortfall::relaxation
                            : bound.is_definite      ? Shortfall::leftover
                            : bound.lambda_min < 0.0 ? Shortfall::negative
                                                     : Shortfall::undecided;
  }
  return certificate;
}

/// What keeps a certificate from the tolerance that was stopped on its way: after a random start,
/// and with a factor that is not kept, the gap is only what is known without any product.
inline Shortfall shortfall_if_stopped(const Certificate& certificate) {
  const bool is_rough =
      certificate.method == CertificateMethod::random_start || std::isnan(certificate.lambda_min);
  const bool is_open = certificate.shortfall == Shortfall::undecided ||
                       (certificate.shortfall == Shortfall::leftover && is_rough);
  return is_open ? Shortfall::stopped : certificate.shortfall;
}

/// The certificate of a graph from those of its components.
inline Certificate certificate_of(std::vector<ComponentCertificate> parts, double tolerance) {
  Certificate certificate;
  certificate.gap = certificate.relative_gap = 0.0;
  certificate.method = CertificateMethod::factorization;
  for (const ComponentCertificate& part : parts) {
    certificate.method = std::max(certificate.method, part.method);
    certificate.gap += part.gap;
    if (!(part.relative_gap <= certificate.relative_gap)) certificate.shortfall = part.shortfall;
    certificate.relative_gap = larger(certificate.relative_gap, part.relative_gap);
    certificate.failure_probability += part.failure_probability;
    certificate.lambda_min = -larger(-certificate.lambda_min, -part.lambda_min);
  }
  certificate.components = std::move(parts);
  certificate.verdict = verdict_of(certificate, tolerance);
  return certificate;
}

}  // namespace detail

}  // namespace rotavg

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/local_operator.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/lanczos.hpp>
#include <rotavg/parallel/threads.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

struct RandomStartOptions {
  double failure_probability = 1e-12;
  std::uint64_t seed = 0;
  double max_products = 5000.0;  ///< of S with a vector, about
  std::function<bool()> keep_going;
};

enum class RandomStartOutcome {
  positive,      ///< no eigenvalue is below the cut, but for the probability
  negative,      ///< a vector x with x^T S x < 0 was met, or the estimate is negative
  inconclusive,  ///< there may be eigenvalues near zero, or more products would be needed
  stopped,
};

struct RandomStartResult {
  RandomStartOutcome outcome = RandomStartOutcome::inconclusive;
  double cut = 0.0;       ///< M is at least this on the complement, where positive
  double quotient = 0.0;  ///< otherwise x^T S x / x^T D x of the x that was met
  Eigen::VectorXd x;      ///< 3n, in the global frame, where that is negative; empty if not kept
};

/// A proof but for a stated probability, where nothing can be factorised: that no eigenvalue of M
/// (local_operator.hpp) on the complement of its null vectors, of dimension N', is below some cut.
///
/// With tau above the cut, y_k = T_k(X) b is a Chebyshev polynomial of X = 1 - 2 (M - tau) / (2 -
/// tau), which maps [tau, 2] to [-1, 1], applied to b, uniform on the unit sphere of the
/// complement. Where all eigenvalues are at least tau, |y_k| <= 1. An eigenvalue below the cut
/// multiplies b's part b_1 along its vector by at least T_k(x) = cosh(k eta), x = cosh(eta) = 1 +
/// 2 (tau - cut) / (2 - tau). So where
///
///     |y_k| < T_k(x) (t - r),
///
/// there is none, or |b_1| < t, which has probability at most sqrt(2 / pi) t sqrt(N'). Two columns
/// are independent, and their probabilities multiply; so do those of several rounds. t is fixed
/// beforehand, one for each number of rounds, and the probabilities of all these add up to the
/// stated one; tau, the cut and k may depend on b, as whatever they are the event is |b_1| < t.
///
/// r is what rounding can have done: an error d_j of step j reaches y_k as U_(k-j)(X) d_j, and
/// U_(k-j)(x) <= T_k(x) e^(-(j-1) eta) / sinh(eta).
///
/// (Kuczynski and Wozniakowski 1992 is the like for Lanczos' method, in exact arithmetic.)
///
/// @tparam OperatorOf LocalOperator or one like it: M on so many columns, the complement, degrees
template <template <int> class OperatorOf>
class RandomStartOf {
 public:
  using Options = RandomStartOptions;
  using Result = RandomStartResult;

  RandomStartOf(OperatorOf<2> M, Options options)
      : operator_(std::move(M)), options_(std::move(options)) {}

  const OperatorOf<2>& M() const { return operator_; }

  /// More products than this are not worth while.
  void limit_products(double max_products) {
    is_limited_ = max_products < options_.max_products;
    options_.max_products = std::min(options_.max_products, max_products);
  }
  bool is_limited() const { return is_limited_; }

  /// Roughly the smallest eigenvalue of M on the complement, by Lanczos' method: never below it.
  double theta() {
    if (std::isnan(theta_)) theta_ = estimate();
    return theta_;
  }

  /// Whether that is above `bound`. To know that it is not takes few products.
  bool theta_exceeds(double bound) {
    if (!std::isnan(theta_)) return theta_ > bound;
    const double value = estimate(bound);
    if (value > bound || is_negative(value)) theta_ = value;
    return value > bound;
  }

  /// Whether as many products may do as there are at most, or the estimate refutes R already. They
  /// do not where theta is small, which takes few to know; that they may promises nothing.
  bool may_do() {
    if (!(options_.failure_probability > 0.0)) return false;
    // As with_estimate() has it, for one round: 2 acosh(2 / t) / eta products.
    const double eta = 2.0 * std::acosh(2.0 / threshold(1)) / options_.max_products;
    const double x = std::cosh(eta) - 1.0;  // 2 (tau - cut) / (2 - tau)
    return theta_exceeds(2.0 * x / (2.0 * (1.0 - cut_share) + x) / tau_share) ||
           is_negative(theta_);
  }

  Result operator()() {
    Result result = with_estimate(theta());
    // Where |y| grew, tau was too large, and y tells by how much.
    constexpr int more = 2;
    for (int k = 0; k < more && result.outcome == RandomStartOutcome::inconclusive; ++k) {
      if (!(result.quotient > 0.0 && result.quotient < theta_)) break;
      theta_ = result.quotient;
      result = with_estimate(theta_);
    }
    return result;
  }

  /// The same with a given estimate of the smallest eigenvalue, be it right or wrong.
  Result with_estimate(double theta) {
    Result result;
    if (stopped_) result.outcome = RandomStartOutcome::stopped;
    // The estimate itself is not below the smallest eigenvalue.
    if (!stopped_ && is_negative(theta)) result.outcome = RandomStartOutcome::negative;
    if (result.outcome != RandomStartOutcome::inconclusive) return result;
    const double tau = std::clamp(tau_share * theta, smallest, 1.0), cut = cut_share * tau;
    const double eta = std::acosh(1.0 + 2.0 * (tau - cut) / (2.0 - tau));
    for (int rounds = 1; rounds <= most_rounds; ++rounds) {
      const double t = threshold(rounds);
      // |y| stays below one: what rounding will amount to.
      const double r = error(1.0) / (std::sinh(eta) * (1.0 - std::exp(-eta)));
      if (r > 0.5 * t && rounds < most_rounds) continue;
      const double steps = std::acosh(2.0 / t) / eta;
      if (2.0 * rounds * steps > options_.max_products) break;
      for (int round = 0; round < rounds; ++round) {
        result = run(tau, cut, eta, t, static_cast<int>(2.0 * steps) + 10,
                     options_.seed * most_rounds + static_cast<std::uint64_t>(round));
        if (result.outcome != RandomStartOutcome::positive) break;
      }
      break;
    }
    return result;
  }

 private:
  using Operator = OperatorOf<2>;
  using Vectors = typename Operator::Vectors;
  static constexpr double pi_ = 3.141592653589793;
  static constexpr double smallest = 1e-9;  ///< tau
  // The larger tau, the fewer steps; but |y| grows where it exceeds the smallest eigenvalue.
  static constexpr double tau_share = 0.9, cut_share = 0.125;
  static constexpr int most_rounds = 3;

  /// t, where so many rounds are to reach their share of the probability together.
  double threshold(int rounds) const {
    const double each = options_.failure_probability / most_rounds;
    return std::pow(each, 0.5 / rounds) /
           (std::sqrt(2.0 / pi_) * std::sqrt(double(operator_.dimension())));
  }

  /// Beyond rounding.
  bool is_negative(double quotient) const { return quotient < -2.0 * error(1.0); }

  bool goes_on() {
    stopped_ = stopped_ || (options_.keep_going && !options_.keep_going());
    return !stopped_;
  }

  /// Of one step from a vector of this length: twice the product, and the operations around it.
  double error(double length) const {
    if (rounding_ == 0.0) rounding_ = operator_.rounding();
    return (4.5 * rounding_ + 100.0 * unit_roundoff) * length;
  }

  /// @param enough what is below this need not be known any better
  double estimate(double enough = -std::numeric_limits<double>::infinity()) {
    const OperatorOf<1> single(operator_);
    using Single = typename OperatorOf<1>::Vectors;
    const Index n = single.num_nodes();
    Single z(static_cast<std::size_t>(n)), Mz(z);
    const int num_threads = single.num_threads();
    std::vector<double> root(z.size());
    for (Index a = 0; a < n; ++a) root[a] = std::sqrt(single.degree(a));
    for (auto& block : Mz) block.setZero();
    // Between z and y = D^1/2 z.
    const auto scaled = [&](const Single& from) {
      Eigen::VectorXd y(3 * static_cast<Eigen::Index>(n));
      parallel_for(n, threads_for_nodes(num_threads, n), [&](Index a) {
        for (int k = 0; k < 3; ++k) y(3 * a + k) = root[a] * from[a](k);
      });
      return y;
    };
    const auto unscale = [&](const Eigen::VectorXd& y) {
      parallel_for(n, threads_for_nodes(num_threads, n), [&](Index a) {
        for (int k = 0; k < 3; ++k) z[a](k) = y(3 * a + k) / root[a];
      });
    };
    const auto apply = [&](const Eigen::VectorXd& y) {
      unscale(y);
      single.apply(z, 1.0, 0.0, 0.0, Mz);
      return scaled(Mz);
    };
    const auto project = [&](Eigen::VectorXd& y) {
      unscale(y);
      single.project(z);
      y = scaled(z);
    };
    LanczosOptions lanczos;
    lanczos.relative_tolerance = 0.5;
    lanczos.min_iterations = 10;
    lanczos.enough = enough;
    lanczos.max_iterations = static_cast<int>(
        std::min({0.25 * options_.max_products, 500.0, double(single.dimension())}));
    lanczos.num_threads = num_threads;
    lanczos.keep_going = [&] { return goes_on(); };
    Eigen::VectorXd start = scaled(single.random(options_.seed ^ 0x1a2b3c4d));
    return smallest_ritz_value(apply, project, std::move(start), lanczos).value;
  }

  Result run(double tau, double cut, double eta, double t, int max_steps, std::uint64_t seed) {
    const double scale = -2.0 / (2.0 - tau), shift = (2.0 + tau) / (2.0 - tau);  // of X
    Vectors previous = operator_.random(seed), z(previous);
    operator_.apply(previous, scale, shift, 0.0, z);
    operator_.project(z);
    double r = error(1.0) * (1.0 + 1.0 / std::sinh(eta));  // of b and of the first step
    double longest = 1.0;                                  // so far
    for (int k = 1; k <= max_steps; ++k) {
      if (!goes_on()) return {RandomStartOutcome::stopped, 0.0, 0.0, {}};
      const auto squares = operator_.products(z, z);
      const bool first = squares[0] > squares[1] || std::isnan(squares[0]);  // a NaN stays
      const double length = std::sqrt(squares[first ? 0 : 1]);
      longest = std::max(longest, length);
      constexpr double grown = 1e3, rounding = 1.0 + 1e-9;
      if (!(length < grown)) break;
      if (rounding * length < std::cosh(k * eta) * (t - r)) {
        return {RandomStartOutcome::positive, cut, 0.0, {}};
      }
      operator_.apply(z, 2.0 * scale, 2.0 * shift, -1.0, previous);
      operator_.project(previous);
      std::swap(z, previous);
      r += error(longest) * std::exp(-k * eta) / std::sinh(eta);
    }
    return rayleigh(z, std::move(previous));
  }

  /// Whether a column of z refutes R.
  Result rayleigh(const Vectors& z, Vectors Sz) const {
    operator_.apply(z, 1.0, 0.0, 0.0, Sz);
    const auto products = operator_.products(z, Sz), squares = operator_.products(z, z);
    const double quotients[2] = {products[0] / squares[0], products[1] / squares[1]};
    const int c = quotients[1] < quotients[0] ? 1 : 0;
    Result result;
    result.quotient = quotients[c];
    if (!is_negative(result.quotient)) return result;
    result.outcome = RandomStartOutcome::negative;
    result.x.resize(3 * static_cast<Eigen::Index>(operator_.num_nodes()));
    for (Index a = 0; a < operator_.num_nodes(); ++a) {
      const Vector3 z_a(z[a](0, c), z[a](1, c), z[a](2, c));
      const Vector3 x_a = operator_.in_global_frame(a, z_a);
      for (int k = 0; k < 3; ++k) result.x(3 * a + k) = x_a(k);
    }
    return result;
  }

  Operator operator_;
  Options options_;
  double theta_ = std::numeric_limits<double>::quiet_NaN();
  bool stopped_ = false, is_limited_ = false;
  mutable double rounding_ = 0.0;
};

/// That of S in local frames.
class RandomStart : public RandomStartOf<LocalOperator> {
 public:
  /// @param S must outlive this object
  /// @param q world_from_i, where S was taken
  RandomStart(const CertificateMatrix& S, const Quaternions& q, Options options)
      : RandomStartOf(LocalOperator<2>(S, q), std::move(options)) {}
};

}  // namespace rotavg

#pragma GCC diagnostic pop

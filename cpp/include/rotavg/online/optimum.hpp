#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/online/closing.hpp>
#include <rotavg/online/component_sums.hpp>
#include <rotavg/online/core_of_component.hpp>
#include <rotavg/online/follow.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/solve.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Keeps the rotations of a graph that grows at the optimum, and what is known of it.
///
/// The bound: let S = Lambda - Rt with *any* symmetric Lambda, S_r > 0 the part without the ground,
/// K = S N at the rotations R of now, and M = N^T S N = sum_i R_i (Lambda_i - Lambda_i(R)) R_i^T.
/// Split x = N c + z, with z zero at the ground: x^T S x >= c^T (M - Q) c with Q = K^T S_r^-1 K, so
/// S with Q - M added at the ground is positive semidefinite, and by duality
///
///     f* >= 6 sum w - tr Lambda - tr(Q - M),     f(R) - f* <= tr Q = |L^-1 K|_F^2,
///
/// as f(R) = 6 sum w - tr Lambda(R). Where Lambda is not that of R, the gap grows by the square of
/// the difference only, so the factor of some steps ago does for many.
///
/// What is factorised is S_r - diag(D + mu), so S_r >= L L^T + diag(mu) in spite of rounding; the
/// computed y solves (L + dL) y = K + dK, |dL| <= gamma |L|, and then
///
///     tr Q <= ( (1 + sqrt(sum gamma)) |y|_F + sqrt(sum |dK_a|^2 / mu_a) )^2,
///
/// as |(dL y)_a|^2 <= gamma_a^2 deg_a |y|^2 and gamma_a deg_a <= mu_a.
class OnlineOptimum {
 public:
  /// @param tended must outlive this object
  /// @param tolerance, certificate_tolerance OnlineOptions
  /// @param moving_tolerance where something moves, how near to the optimum it goes
  OnlineOptimum(TendedCore& tended, double tolerance, double certificate_tolerance,
                double moving_tolerance)
      : tended_(tended),
        follower_(tended),
        tolerance_(tolerance),
        certificate_tolerance_(certificate_tolerance),
        moving_tolerance_(moving_tolerance) {}

  StepCounts& counts() { return follower_.counts; }
  /// Nodes that moved since this was cleared, perhaps several times.
  std::vector<Index>& turned() { return follower_.turned; }
  double relative_gradient() const { return follower_.relative_gradient; }

  /// What an edge that is not in use yet would cost, if that can be told.
  std::optional<Closing> foretell(const OnlineEdge& e) {
    if (tended_.has_loosened) return std::nullopt;
    OnlineComponent& component = tended_.component_of(e.i);
    const double gap = gap_by_factor(component);
    if (!std::isfinite(gap)) return std::nullopt;
    std::optional<Closing> closing = rotavg::foretell(tended_, e, gap);
    if (closing) closing->least_cost -= component.gap;  // of what waits
    return closing;
  }

  double relative_gap(const OnlineComponent& component) const {
    if (component.num_edges == 0) return 0.0;
    const double floor = detail::objective_floor * component.counted;
    return component.gap / std::max(component.objective, floor);
  }

  /// After changes of the graph.
  /// @param may_wait what is proved to gain less than the tolerance is put off until more has come
  void settle(bool may_wait) {
    for (OnlineComponent& component : tended_.components) {
      if (component.is_touched) sum_if_drifted(component);
    }
    if (may_wait && !tended_.touched.empty() && wait()) return;
    move();
    certify();
  }

  /// The same, for as long as weights still change: what is proved has to be found out by
  /// certify().
  void move_on() {
    move();
    for (OnlineComponent& component : tended_.components) {
      const bool is_lost = component.is_touched && !component.has_converged;
      if (component.ground >= 0 && is_lost) certify(component);
    }
  }

  /// What is proved of all that was touched.
  void certify() {
    for (std::size_t c = 0; c < tended_.components.size(); ++c) {
      OnlineComponent& component = tended_.components[c];
      if (component.ground < 0 || !std::exchange(component.is_touched, false)) continue;
      certify(component);
    }
  }

 private:
  void move() {
    if (tended_.touched.empty()) return;
    follower_.take_in();
    converge();
    follower_.look_back();
  }

  /// Puts off what has come, if at the rotations of now the lower bound of earlier steps alone says
  /// enough; the gaps are then by that.
  bool wait() {
    for (OnlineComponent& component : tended_.components) {
      if (!component.is_touched) continue;
      bring_sums_up_to_date(component);
      component.gap = gap_by_lower_bound(component);
      if (!(component.gap <= enough(component) && is_proved(component))) return false;
    }
    return true;
  }

  void sum_if_drifted(OnlineComponent& component) const {
    constexpr double negligible = 1e-13;
    if (component.drift > negligible * component.objective) {
      sum_objective(component, tended_.graph());
    }
  }

  /// The f(R) - f* that is asked for.
  double enough(const OnlineComponent& component) const {
    return tolerance_ * component.objective + rounding(component);
  }
  double enough_in_motion(const OnlineComponent& component) const {
    return moving_tolerance_ * component.objective + rounding(component);
  }

  /// What one more step would gain is |y|^2 of the gradient alone, and what all would, where gains
  /// fall by a factor of rho, about |y|^2 / (1 - sqrt(rho)). Slow directions show in the gradient
  /// when that is small.
  void converge() {
    double noise = 1.0;
    for (OnlineComponent& component : tended_.components) {
      component.gained = component.to_gain = 0.0;
      if (!component.is_touched || !(component.objective > 0.0)) continue;
      noise = std::min(noise, std::sqrt(component.objective / component.weight));
    }
    // Of the residuals. Where these are large the Hessian can be much softer than S.
    constexpr double negligible = 1e-4, large_noise = 0.1;
    const double strict = 1e-3 * std::sqrt(moving_tolerance_);
    const double gradient = noise < large_noise ? 1.0 : std::max(strict * noise, 1e-13);
    double left = 0.0;
    const bool converged = follower_.converge(negligible * noise, [&](double largest_gradient) {
      left = largest_gradient;
      for (OnlineComponent& component : tended_.components) {
        component.gained = std::exchange(component.to_gain, 0.0);
      }
      tended_.tree.for_each_root([&](Index i, const Clique& clique) {
        tended_.component_of(i).to_gain += clique.solution[for_step].energy;
      });
      return left <= gradient &&
             std::all_of(tended_.components.begin(), tended_.components.end(),
                         [&](const OnlineComponent& component) { return is_near(component); });
    });
    for (OnlineComponent& component : tended_.components) {
      if (!component.is_touched) continue;
      component.has_converged = (converged || left <= gradient) && has_factor(component);
    }
  }

  bool is_near(const OnlineComponent& component) const {
    if (!component.is_touched) return true;
    const double rho = component.gained > 0.0 ? component.to_gain / component.gained : 0.0;
    return component.to_gain <= enough_in_motion(component) * (1.0 - std::sqrt(std::min(rho, 1.0)));
  }

  bool has_factor(const OnlineComponent& component) const {
    return follower_.has_factor(tended_.core.node(component.ground).component);
  }

  /// f(R) - f* by the factor; infinite where there is none.
  double gap_by_factor(const OnlineComponent& component) {
    if (!has_factor(component)) return std::numeric_limits<double>::infinity();
    double energy = 0.0, rounding = 0.0, gamma = 0.0;
    tended_.tree.solve_lower(for_bound);
    tended_.tree.for_each_root([&](Index i, const Clique& clique) {
      if (&tended_.component_of(i) != &component) return;
      energy += clique.solution[for_bound].energy;
      rounding += clique.rounding;
      gamma += clique.gamma;
    });
    constexpr double margin = 1.0 + 1e-9;  // for the rounding of these sums
    const double root = (1.0 + std::sqrt(gamma)) * std::sqrt(energy) + std::sqrt(rounding);
    return margin * root * root;
  }

  /// How far a component's objective, as it is known, can be from that of its rotations.
  static double rounding(const OnlineComponent& component) {
    return component.drift + objective_rounding(component.weight, component.objective);
  }

  /// The lower bound only grows, but for weight that goes.
  static double gap_by_lower_bound(const OnlineComponent& component) {
    return std::max(component.objective - component.lower_bound + rounding(component), 0.0);
  }

  void bring_sums_up_to_date(OnlineComponent& component) const {
    if (!component.is_counted) count_weights(component, tended_.graph());
    if (component.num_edges == 0) {
      component.objective = component.drift = component.weight = component.counted = 0.0;
    }
  }

  void take_bound(OnlineComponent& component) {
    sum_if_drifted(component);
    bring_sums_up_to_date(component);
    const double by_factor = gap_by_factor(component), error = rounding(component);
    component.lower_bound =
        std::max(component.lower_bound, component.objective - by_factor - error);
    component.gap = std::min(by_factor, gap_by_lower_bound(component));
  }

  bool is_proved(const OnlineComponent& component) const {
    return relative_gap(component) <= certificate_tolerance_;
  }

  void certify(OnlineComponent& component) {
    take_bound(component);
    constexpr int most = 4;
    for (int k = 0; k < most && !is_proved(component); ++k) {
      const std::vector<Index> nodes =
          k + 1 < most ? heavy_nodes(component) : stale_nodes(component);
      if (nodes.empty()) continue;
      follower_.refresh(nodes);
      converge_again(component);
      take_bound(component);
    }
    const bool is_done = is_proved(component) && component.has_converged;
    if (is_done || component.num_edges < component.no_solve_below) return;
    solve_component(component);
  }

  void converge_again(OnlineComponent& component) {
    component.is_touched = true;
    converge();
    component.is_touched = false;
  }

  /// Nodes whose dual has to follow the rotations, if the gap is to fall well below the tolerance.
  std::vector<Index> heavy_nodes(const OnlineComponent& component) const {
    constexpr double part = 0.1;
    const double rest = part * certificate_tolerance_ * component.objective;
    std::vector<Index> nodes;
    tended_.tree.for_each_root([&](Index i, const Clique& clique) {
      if (&tended_.components[tended_.core.node(i).component] != &component) return;
      const std::vector<Index> heavy = tended_.tree.heaviest(clique, rest);
      nodes.insert(nodes.end(), heavy.begin(), heavy.end());
    });
    return nodes;
  }

  /// All nodes whose dual is not that of the rotations.
  std::vector<Index> stale_nodes(const OnlineComponent& component) const {
    std::vector<Index> nodes;
    for (const Index i : component.nodes) {
      const OnlineNode& node = tended_.core.node(i);
      if (node.kind == NodeKind::core && node.less != node.dual) nodes.push_back(i);
    }
    return nodes;
  }

  /// All of a component by solve(), from where it is.
  void solve_component(OnlineComponent& component) {
    ++counts().solved;
    const CoreOfComponent of_core(tended_, component);
    if (of_core.measurements.empty()) return;
    SolveOptions options;
    options.certificate.tolerance = certificate_tolerance_;
    options.certificate.failure_probability = 0.0;
    options.iteration.num_threads = 1;
    const MeasurementGraph part = of_core.graph();
    Solution solution = rotavg::solve(part, options, of_core.rotations);
    if (solution.certificate.verdict != Verdict::proved) {  // perhaps a local optimum
      Solution other = rotavg::solve(part, options);
      if (other.objective < solution.objective) solution = std::move(other);
    }
    const double gain = component.objective - solution.objective;
    const bool proved = solution.certificate.verdict == Verdict::proved;
    if (gain > 0.0 || proved) {
      const std::vector<Index> core_nodes = of_core.place(tended_, solution.rotations);
      sum_objective(component, tended_.graph());
      turned().insert(turned().end(), core_nodes.begin(), core_nodes.end());
      follower_.refresh(core_nodes);
      if (!proved) converge_again(component);
      component.has_converged = true;
    }
    if (proved) {
      component.lower_bound =
          std::max(component.lower_bound,
                   solution.objective - solution.certificate.gap - rounding(component));
    }
    take_bound(component);
    if (proved && !is_proved(component)) {  // too little noise for the factor of the tree
      const CoreOfComponent now(tended_, component);
      const Certificate certificate = rotavg::certify(part, now.rotations, options.certificate);
      if (certificate.verdict == Verdict::proved) {
        component.gap = std::min(component.gap, certificate.gap);
      }
    }
    constexpr Index few = 1000;  // edges: solve() takes no time
    const bool ask_soon = is_proved(component) || component.num_edges < few;
    component.no_solve_below = ask_soon ? 0 : component.num_edges + component.num_edges / 10;
  }

  TendedCore& tended_;
  Follower follower_;
  double tolerance_, certificate_tolerance_, moving_tolerance_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

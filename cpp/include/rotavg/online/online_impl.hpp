#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/online/follow.hpp>
#include <rotavg/online/online.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/solve.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The bound. Let S = Lambda - Rt with *any* symmetric Lambda, S_r > 0 the part without the ground,
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
class Online::Impl {
 public:
  explicit Impl(const OnlineOptions& options) : options_(options) {
    const auto require = [](bool holds, const char* what) {
      if (!holds) throw std::invalid_argument(what);
    };
    require(options.tolerance > 0.0, "the tolerance must be a positive number");
    require(options.certificate_tolerance >= 0.0,
            "the certificate's tolerance must be a number that is not negative");
    require(options.loss != Loss::automatic, "the loss auto is none of those for online use");
    require(options.loss == Loss::l2 || (options.loss_scale > 0.0 && options.loss_scale <= 10.0),
            "a robust loss online needs its scale, in radians");
  }

  std::vector<Index> add(const std::vector<RelativeRotation>& edges,
                         const std::vector<bool>& trusted, const std::vector<NodeId>& nodes) {
    if (!trusted.empty() && trusted.size() != edges.size()) {
      throw std::invalid_argument("expected one value of `trusted` for each edge");
    }
    std::vector<OnlineEdge> checked;
    for (std::size_t k = 0; k < edges.size(); ++k) {
      RelativeRotation m = edges[k];
      if (m.weight == 0.0) m.weight = 1.0;
      OnlineEdge e;
      e.i_from_j = check_measurement(static_cast<Index>(k), m);
      e.given = edges[k].weight;
      e.trusted = !trusted.empty() && trusted[k];
      checked.push_back(e);
    }
    for (const NodeId id : nodes) node_of(id);
    std::vector<Index> numbers;
    for (std::size_t k = 0; k < edges.size(); ++k) {
      OnlineEdge& e = checked[k];
      e.i = node_of(edges[k].i);
      e.j = node_of(edges[k].j);
      e.weight = e.given;
      numbers.push_back(tended_.core.graph().add_edge(e));
      if (e.given > 0.0) tended_.use(numbers.back());
    }
    follow(numbers);
    return numbers;
  }

  void remove(const std::vector<Index>& edges) {
    check_numbers(edges);
    for (const Index k : edges) {
      num_outliers_ -= is_outlier(k);
      if (graph().edge(k).weight > 0.0) {
        tended_.drop(k, true);
      } else {
        tended_.core.graph().remove_edge(k);
      }
    }
    follow({});
  }

  void set_weights(const std::vector<Index>& edges, const std::vector<double>& weights) {
    if (weights.size() != edges.size()) {
      throw std::invalid_argument("found " + std::to_string(weights.size()) +
                                  " weights; expected " + std::to_string(edges.size()) +
                                  ", one for each edge");
    }
    check_numbers(edges);
    for (std::size_t k = 0; k < edges.size(); ++k) {
      if (weights[k] != 0.0) check_weight(static_cast<Index>(k), weights[k]);
    }
    for (std::size_t k = 0; k < edges.size(); ++k) {
      OnlineEdge& e = tended_.core.graph().edge(edges[k]);
      const double left = e.given > 0.0 ? e.weight / e.given : 1.0;
      num_outliers_ -= is_outlier(edges[k]);
      e.given = weights[k];
      use_weight(edges[k], weights[k] * left);
      num_outliers_ += is_outlier(edges[k]);
    }
    follow(edges);
  }

  const OnlineState& state() const { return state_; }
  const GrowingGraph& graph() const { return tended_.graph(); }
  Matrix3 rotation(Index i) const { return tended_.core.rotation(i).toRotationMatrix(); }

  Rotations rotations() const {
    Rotations R(graph().ids().size());
    for (const OnlineComponent& component : tended_.components) {
      if (component.nodes.empty()) continue;
      const Index first = *std::min_element(component.nodes.begin(), component.nodes.end());
      const Quaternion back = tended_.core.rotation(first).conjugate();
      for (const Index i : component.nodes) {
        const Quaternion q(product(back, tended_.core.rotation(i)));
        R[i] = i == first ? Matrix3(Matrix3::Identity()) : q.normalized().toRotationMatrix();
      }
    }
    return R;
  }

 private:
  Index node_of(NodeId id) {
    const Index row = graph().find(id);
    return row >= 0 ? row : tended_.add_node(id);
  }

  void check_numbers(const std::vector<Index>& edges) const {
    std::unordered_set<Index> seen;
    for (std::size_t p = 0; p < edges.size(); ++p) {
      const Index k = edges[p];
      const auto refuse = [&](const char* what) {
        throw InvalidEdge(static_cast<Index>(p), "number " + std::to_string(k) + what);
      };
      if (k < 0 || k >= graph().num_edges()) refuse(" is that of no edge");
      if (!graph().edge(k).is_there) refuse(" is that of an edge that was removed");
      if (!seen.insert(k).second) refuse(" stands twice");
    }
  }

  void use_weight(Index k, double weight) {
    const bool was_used = graph().edge(k).weight > 0.0;
    if (was_used && !(weight > 0.0)) {
      tended_.drop(k, false);
    } else if (was_used) {
      tended_.set_weight(k, weight);
    } else if (weight > 0.0) {
      tended_.core.graph().set_weight(k, weight);
      tended_.use(k);
    }
  }

  bool is_outlier(Index k) const {
    const OnlineEdge& e = graph().edge(k);
    return e.weight < 0.5 * e.given;
  }

  /// After the graph has changed.
  /// @param changed edges, which a robust loss looks at
  void follow(std::vector<Index> changed) {
    follower_.counts = StepCounts();
    follower_.turned.clear();
    settle();
    if (options_.loss != Loss::l2) {
      constexpr int most = 30;
      std::unordered_set<Index> dropped, pardoned;
      for (int k = 0; k < most && reweight(changed, dropped, pardoned); ++k) settle();
    }
    count();
  }

  /// One round of reweighting. Of the truncated loss the edge that is furthest beyond the scale
  /// goes, alone, for the others may be there because of it; and those come back that the rotations
  /// of now agree with. Others get the weights of their residuals.
  /// @param edges those that are new; receives those at nodes that have moved
  /// @returns whether a weight has changed
  bool reweight(std::vector<Index>& edges, std::unordered_set<Index>& dropped,
                std::unordered_set<Index>& pardoned) {
    for (const Index i : follower_.turned) {
      for (const GrowingGraph::End& end : graph().ends(i)) edges.push_back(end.edge);
    }
    follower_.turned.clear();
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    constexpr double coarse = 1e-3;
    const bool truncated = options_.loss == Loss::tls;
    const RobustLoss loss{options_.loss, options_.loss_scale};
    std::vector<std::pair<Index, double>> parts;
    double worst = 0.0;
    Index furthest = -1;
    for (const Index k : edges) {
      const OnlineEdge& e = graph().edge(k);
      const bool hangs = e.weight > 0.0 && !e.in_core;
      if (!e.is_there || e.trusted || !(e.given > 0.0) || hangs) continue;
      const double x = squared_chord(k), part = loss.weight(x);
      if (truncated && part == 0.0 && e.weight > 0.0) {
        if (x > worst && dropped.count(k) == 0 && !tended_.is_bridge(k)) {
          worst = x;
          furthest = k;
        }
      } else if (std::abs(part - e.weight / e.given) > coarse) {
        if (!truncated || pardoned.insert(k).second) parts.emplace_back(k, part);
      }
    }
    if (furthest >= 0) {
      dropped.insert(furthest);
      parts.emplace_back(furthest, 0.0);
    }
    for (const auto& [k, part] : parts) {
      num_outliers_ -= is_outlier(k);
      use_weight(k, part * graph().edge(k).given);
      num_outliers_ += is_outlier(k);
    }
    return !parts.empty();
  }

  /// r^2 of RobustLoss.
  double squared_chord(Index k) const {
    const OnlineEdge& e = graph().edge(k);
    const Quaternion q_i = tended_.core.rotation(e.i), q_j = tended_.core.rotation(e.j);
    return tended_.core.cost(k, q_i, q_j) / (2.0 * e.i_from_j.squaredNorm());
  }

  void settle() {
    for (OnlineComponent& component : tended_.components) {
      const double enough = 1e-3 * options_.tolerance * component.objective;
      if (component.is_touched && component.drift > enough) tended_.sum_objective(component);
    }
    if (!tended_.touched.empty()) {
      follower_.take_in();
      converge();
      follower_.look_back();
    }
    for (std::size_t c = 0; c < tended_.components.size(); ++c) {
      OnlineComponent& component = tended_.components[c];
      if (component.ground < 0 || !std::exchange(component.is_touched, false)) continue;
      certify(component);
    }
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
    constexpr double negligible = 1e-4, strict = 1e-8, large_noise = 0.1;
    const double gradient = noise < large_noise ? 1.0 : std::max(strict * noise, 1e-13);
    const bool converged = follower_.converge(negligible * noise, [&] {
      for (OnlineComponent& component : tended_.components) {
        component.gained = std::exchange(component.to_gain, 0.0);
      }
      tended_.tree.for_each_root([&](Index i, const Clique& clique) {
        tended_.component_of(i).to_gain += clique.solution[for_step].energy;
      });
      return follower_.relative_gradient <= gradient &&
             std::all_of(tended_.components.begin(), tended_.components.end(),
                         [&](const OnlineComponent& component) { return is_near(component); });
    });
    for (OnlineComponent& component : tended_.components) {
      if (!component.is_touched) continue;
      component.has_converged = converged || follower_.relative_gradient <= gradient;
    }
  }

  bool is_near(const OnlineComponent& component) const {
    if (!component.is_touched) return true;
    const double rho = component.gained > 0.0 ? component.to_gain / component.gained : 0.0;
    const double enough = options_.tolerance * component.objective + rounding(component);
    return component.to_gain <= enough * (1.0 - std::sqrt(std::min(rho, 1.0)));
  }

  /// f(R) - f* by the factor.
  double gap_by_factor(const OnlineComponent& component) {
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

  double relative_gap(const OnlineComponent& component) const {
    if (component.num_edges == 0) return 0.0;
    const double floor = detail::objective_floor * component.weight;
    return component.gap / std::max(component.objective, floor);
  }

  void take_bound(OnlineComponent& component) {
    if (component.num_edges == 0) component.objective = component.drift = component.weight = 0.0;
    const double by_factor = gap_by_factor(component), error = rounding(component);
    component.lower_bound =
        std::max(component.lower_bound, component.objective - by_factor - error);
    component.gap =
        std::max(std::min(by_factor, component.objective - component.lower_bound + error), 0.0);
  }

  bool is_proved(const OnlineComponent& component) const {
    return relative_gap(component) <= options_.certificate_tolerance;
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
    const double rest = part * options_.certificate_tolerance * component.objective;
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
    ++follower_.counts.solved;
    std::vector<RelativeQuaternion> measurements;
    std::vector<NodeId> rows;
    Rotations start;
    std::vector<Index> nodes;
    for (const Index i : component.nodes) {
      if (tended_.core.node(i).kind == NodeKind::hanging) continue;
      nodes.push_back(i);
      rows.push_back(i);
      start.push_back(rotation(i));
      for (const GrowingGraph::End& end : graph().ends(i)) {
        const OnlineEdge& e = graph().edge(end.edge);
        if (e.i != i || !e.in_core || !(e.weight > 0.0)) continue;
        measurements.push_back({e.i, e.j, e.i_from_j, e.weight});
      }
    }
    if (measurements.empty()) return;
    SolveOptions options;
    options.certificate.tolerance = options_.certificate_tolerance;
    options.certificate.failure_probability = 0.0;
    options.iteration.num_threads = 1;
    const MeasurementGraph part(
        measurements.size(), [&](std::size_t k) { return measurements[k]; }, rows);
    Solution solution = rotavg::solve(part, options, start);
    if (solution.certificate.verdict != Verdict::proved) {  // perhaps a local optimum
      Solution other = rotavg::solve(part, options);
      if (other.objective < solution.objective) solution = std::move(other);
    }
    const double gain = component.objective - solution.objective;
    const bool proved = solution.certificate.verdict == Verdict::proved;
    if (gain > 0.0 || proved) {
      const Index ground = component.ground;
      Quaternion turn = Quaternion::Identity();
      for (std::size_t a = 0; a < nodes.size(); ++a) {
        if (nodes[a] == ground) {
          turn = Quaternion(product(tended_.core.node(ground).q,
                                    to_quaternion(solution.rotations[a]).conjugate()));
        }
      }
      for (std::size_t a = 0; a < nodes.size(); ++a) {
        if (nodes[a] == ground) continue;
        tended_.core.node(nodes[a]).q =
            Quaternion(product(turn, to_quaternion(solution.rotations[a]))).normalized();
      }
      for (const Index i : nodes) {
        for (const GrowingGraph::End& end : graph().ends(i)) {
          const OnlineEdge& e = graph().edge(end.edge);
          if (e.i == i && e.in_core && e.weight > 0.0) tended_.update_edge(end.edge);
        }
      }
      std::vector<Index> core_nodes;
      for (const Index i : nodes) {
        if (tended_.core.node(i).kind != NodeKind::core) continue;
        tended_.update_node(i);
        core_nodes.push_back(i);
      }
      tended_.sum_objective(component);
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
      Rotations R;
      for (const Index i : nodes) R.push_back(rotation(i));
      const Certificate certificate = rotavg::certify(part, R, options.certificate);
      if (certificate.verdict == Verdict::proved) {
        component.gap = std::min(component.gap, certificate.gap);
      }
    }
    constexpr Index few = 1000;  // edges: solve() takes no time
    const bool ask_soon = is_proved(component) || component.num_edges < few;
    component.no_solve_below = ask_soon ? 0 : component.num_edges + component.num_edges / 10;
  }

  void count() {
    state_ = OnlineState();
    state_.num_outliers = num_outliers_;
    state_.num_nodes = graph().num_nodes();
    state_.num_edges = 0;
    state_.num_components = tended_.num_components;
    for (const OnlineComponent& component : tended_.components) {
      if (component.ground < 0) continue;
      state_.num_edges += component.num_edges;
      state_.objective += component.objective;
      state_.gap += component.gap;
      state_.relative_gap = detail::larger(state_.relative_gap, relative_gap(component));
    }
    state_.verdict = state_.relative_gap <= options_.certificate_tolerance ? Verdict::proved
                                                                           : Verdict::not_certified;
    state_.relative_gradient = follower_.relative_gradient;
    state_.iterations = follower_.counts.iterations;
    state_.eliminated = follower_.counts.eliminated;
    state_.moved = follower_.counts.moved;
    state_.refreshed = follower_.counts.refreshed;
    state_.solved = follower_.counts.solved;
  }

  OnlineOptions options_;
  TendedCore tended_;
  Follower follower_{tended_};
  OnlineState state_;
  Index num_outliers_ = 0;
};

ROTAVG_INLINE Online::Online(const OnlineOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}
ROTAVG_INLINE Online::~Online() = default;
ROTAVG_INLINE Online::Online(Online&&) noexcept = default;
ROTAVG_INLINE Online& Online::operator=(Online&&) noexcept = default;

ROTAVG_INLINE std::vector<Index> Online::add(const std::vector<RelativeRotation>& edges,
                                             const std::vector<bool>& trusted,
                                             const std::vector<NodeId>& nodes) {
  return impl_->add(edges, trusted, nodes);
}
ROTAVG_INLINE void Online::remove(const std::vector<Index>& edges) { impl_->remove(edges); }
ROTAVG_INLINE void Online::set_weights(const std::vector<Index>& edges,
                                       const std::vector<double>& weights) {
  impl_->set_weights(edges, weights);
}
ROTAVG_INLINE const OnlineState& Online::state() const { return impl_->state(); }
ROTAVG_INLINE const std::vector<NodeId>& Online::nodes() const { return impl_->graph().ids(); }
ROTAVG_INLINE Rotations Online::rotations() const { return impl_->rotations(); }
ROTAVG_INLINE Matrix3 Online::rotation(NodeId node) const {
  const Index row = impl_->graph().find(node);
  if (row < 0) {
    throw std::invalid_argument("node " + std::to_string(node) + " is not in the graph");
  }
  return impl_->rotation(row);
}
ROTAVG_INLINE std::vector<double> Online::edge_weights() const {
  std::vector<double> weights;
  for (Index k = 0; k < impl_->graph().num_edges(); ++k) {
    weights.push_back(impl_->graph().edge(k).weight);
  }
  return weights;
}
ROTAVG_INLINE std::vector<RelativeRotation> Online::edges(std::vector<Index>& numbers) const {
  std::vector<RelativeRotation> edges;
  numbers.clear();
  const GrowingGraph& graph = impl_->graph();
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const OnlineEdge& e = graph.edge(k);
    if (!e.is_there) continue;
    Matrix3 R = weighted_rotation(e.i_from_j);
    R /= e.i_from_j.squaredNorm();
    edges.push_back({graph.ids()[e.i], graph.ids()[e.j], R, e.given});
    numbers.push_back(k);
  }
  return edges;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

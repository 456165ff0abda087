#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/online/online.hpp>
#include <rotavg/online/optimum.hpp>
#include <rotavg/online/reweight.hpp>
#include <rotavg/online/second_opinion.hpp>
#include <rotavg/online/tended_core.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Checks what is given, and hands it on.
class OnlineEngine {
 public:
  explicit OnlineEngine(const OnlineOptions& options)
      : options_(options),
        certificate_tolerance_(std::max(options.certificate_tolerance, options.tolerance)),
        optimum_(tended_, options.tolerance, certificate_tolerance_, moving_tolerance(options)),
        weights_(tended_, {options.loss, options.loss_scale}),
        second_opinion_(tended_, {options.loss, options.loss_scale}) {
    const auto require = [](bool holds, const char* what) {
      if (!holds) throw std::invalid_argument(what);
    };
    require(options.tolerance > 0.0 && options.tolerance < 1.0,
            "the tolerance must be a number between 0 and 1");
    require(options.certificate_tolerance >= 0.0,
            "the certificate's tolerance must be a number that is not negative");
    require(options.loss != Loss::automatic, "the loss auto is none of those for online use");
    require(options.loss == Loss::l2 || is_loss_scale(options.loss_scale),
            "a robust loss online needs its scale, radians between 1e-6 and pi");
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
    begin_step();
    for (const NodeId id : nodes) node_of(id);
    std::vector<Index> numbers;
    for (std::size_t k = 0; k < edges.size(); ++k) {
      OnlineEdge& e = checked[k];
      e.i = node_of(edges[k].i);
      e.j = node_of(edges[k].j);
      e.weight = 0.0;
      numbers.push_back(tended_.core.graph().add_edge(e));
    }
    use(numbers);
    follow(numbers);
    return numbers;
  }

  void remove(const std::vector<Index>& edges) {
    check_numbers(edges);
    begin_step();
    for (const Index k : edges) {
      weights_.num_outliers -= weights_.is_outlier(k);
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
    begin_step();
    for (std::size_t k = 0; k < edges.size(); ++k) {
      OnlineEdge& e = tended_.core.graph().edge(edges[k]);
      const double left = e.given > 0.0 ? e.weight / e.given : 1.0;
      weights_.num_outliers -= weights_.is_outlier(edges[k]);
      e.given = weights[k];
      weights_.use_weight(edges[k], weights[k] * left);
      weights_.num_outliers += weights_.is_outlier(edges[k]);
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
  /// A robust loss judges residuals: where they move at all, they move to their end.
  static double moving_tolerance(const OnlineOptions& options) {
    constexpr double strict = 1e-8;
    return options.loss == Loss::l2 ? options.tolerance : std::min(options.tolerance, strict);
  }

  Index node_of(NodeId id) {
    const Index row = graph().find(id);
    return row >= 0 ? row : tended_.add_node(id);
  }

  /// New edges: those that join components, odometry first; those that the loss does not judge; and
  /// then the others, at the weights that it can foretell from where these are met.
  void use(std::vector<Index> edges) {
    if (options_.loss != Loss::l2) {
      std::stable_partition(edges.begin(), edges.end(),
                            [&](Index k) { return graph().edge(k).trusted; });
    }
    std::vector<Index> closings;
    bool has_moved = false;
    for (const Index k : edges) {
      const OnlineEdge& e = graph().edge(k);
      const bool joins = tended_.core.node(e.i).component != tended_.core.node(e.j).component;
      if (!joins && weights_.is_foretold(k)) {
        closings.push_back(k);
      } else {
        weights_.use_weight(k, e.given);
        has_moved = has_moved || !joins || tended_.has_loosened;
      }
    }
    if (closings.empty()) return;
    if (has_moved) optimum_.settle(/*may_wait=*/false);
    for (const Index k : closings) weights_.num_outliers += weights_.is_outlier(k);
    close(std::move(closings));
  }

  /// Edges that close cycles, as far as the loss foretells that they can be used. Where some are
  /// and others are not, these are looked at again.
  void close(std::vector<Index> edges) {
    constexpr int most = 10;
    for (int k = 0; k < most && !edges.empty(); ++k) {
      if (k > 0) optimum_.settle(/*may_wait=*/false);
      std::vector<std::pair<Index, double>> used;
      std::vector<Index> left_out;
      for (const Index e : edges) {
        const double part = weights_.foretold_part(e, optimum_);
        if (part > 0.0) {
          used.emplace_back(e, part);
        } else {
          left_out.push_back(e);
        }
      }
      weights_.use_parts(used);
      if (used.empty()) return;
      edges = std::move(left_out);
    }
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

  void begin_step() {
    optimum_.counts() = StepCounts();
    optimum_.turned().clear();
    num_second_opinions_ = 0;
  }

  /// After the graph has changed.
  /// @param changed edges, which a robust loss looks at
  void follow(std::vector<Index> changed) {
    optimum_.settle(/*may_wait=*/options_.loss == Loss::l2 || weights_.would_stay(changed));
    if (options_.loss != Loss::l2) {
      weights_.left_out.clear();
      weights_.append_left_out(changed);
      reweight(std::move(changed));
      second_opinion_.note(weights_.left_out, weights_.num_outliers);
      if (options_.second_opinions && second_opinion_.is_due()) {
        ask();
        second_opinion_.has_asked(weights_.num_outliers);
      }
    }
    tended_.parted.clear();
    count();
  }

  /// What is proved is found out where weights no longer change; if that moves nodes (by solve()),
  /// they may change once more.
  void reweight(std::vector<Index> changed) {
    constexpr int most = 30, most_proofs = 3;
    std::unordered_set<Index> dropped, pardoned;
    for (int proofs = 0; proofs < most_proofs; ++proofs) {
      for (int k = 0; k < most && weights_(optimum_.turned(), changed, dropped, pardoned); ++k) {
        optimum_.move_on();
      }
      optimum_.certify();
      if (optimum_.turned().empty()) break;
    }
  }

  /// All edges are judged at once, in every component.
  void ask() {
    ++num_second_opinions_;
    std::vector<std::pair<Index, double>> parts;
    for (const OnlineComponent& component : tended_.components) {
      if (component.ground < 0) continue;
      const auto of_component = second_opinion_.ask(component);
      parts.insert(parts.end(), of_component.begin(), of_component.end());
    }
    if (parts.empty()) return;
    weights_.take(parts);
    optimum_.settle(/*may_wait=*/false);
    reweight({});
  }

  void count() {
    state_ = OnlineState();
    state_.num_outliers = weights_.num_outliers;
    state_.num_nodes = graph().num_nodes();
    state_.num_edges = 0;
    state_.num_components = tended_.num_components;
    for (const OnlineComponent& component : tended_.components) {
      if (component.ground < 0) continue;
      state_.num_edges += component.num_edges;
      state_.objective += component.objective;
      state_.gap += component.gap;
      state_.relative_gap = larger(state_.relative_gap, optimum_.relative_gap(component));
    }
    state_.verdict =
        state_.relative_gap <= certificate_tolerance_ ? Verdict::proved : Verdict::not_certified;
    state_.relative_gradient = optimum_.relative_gradient();
    state_.iterations = optimum_.counts().iterations;
    state_.eliminated = optimum_.counts().eliminated;
    state_.moved = optimum_.counts().moved;
    state_.refreshed = optimum_.counts().refreshed;
    state_.solved = optimum_.counts().solved;
    state_.num_second_opinions = num_second_opinions_;
  }

  OnlineOptions options_;
  double certificate_tolerance_;
  TendedCore tended_;
  OnlineOptimum optimum_;
  OnlineWeights weights_;
  SecondOpinion second_opinion_;
  OnlineState state_;
  int num_second_opinions_ = 0;
};

}  // namespace detail

ROTAVG_INLINE Online::Online(const OnlineOptions& options)
    : impl_(std::make_unique<detail::OnlineEngine>(options)) {}
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
    edges.push_back({graph.ids()[e.i], graph.ids()[e.j], e.rotation(), e.given});
    numbers.push_back(k);
  }
  return edges;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

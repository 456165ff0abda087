#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What a step did.
struct StepCounts {
  int iterations = 0;
  Index eliminated = 0, moved = 0;
  int refreshed = 0, solved = 0;
};

/// Lets factor and rotations follow a core that has changed.
class Follower {
 public:
  explicit Follower(TendedCore& tended) : tended_(tended), core_(tended.core), tree_(tended.tree) {}

  StepCounts counts;
  std::vector<Index> turned;  ///< nodes that moved since this was cleared, perhaps several times
  double relative_gradient = 0.0;

  /// The sums at the nodes that were touched, and the factor. Of the residuals of new edges the
  /// dual takes only what will be left of them, as far as that can be foreseen.
  void take_in() {
    std::vector<Index> touched;
    for (const Index i : tended_.touched) {
      if (core_.node(i).kind != NodeKind::core) continue;
      tended_.update_node(i);
      touched.push_back(i);
    }
    tended_.clear_touched();
    tree_.detach(touched);
    move_dual();
    fresh_.clear();
    std::vector<Index>& fresh = tended_.fresh;  // one may have come, gone, and come again
    std::sort(fresh.begin(), fresh.end());
    fresh.erase(std::unique(fresh.begin(), fresh.end()), fresh.end());
    for (const Index k : fresh) {
      const OnlineEdge& e = tended_.graph().edge(k);
      if (!e.in_core || !(e.weight > 0.0)) continue;
      fresh_.emplace_back(k, e.cost);
      for (const Index i : {e.i, e.j}) {
        if (core_.node(i).kind != NodeKind::core) continue;
        const Vector3 v = vector_part(i == e.i ? e.at_i : e.at_j);
        const double relaxed = 2.0 * (1.0 - left_over_);
        Matrix3& dual = core_.node(i).dual;
        add(dual, outer_product(relaxed * v, v));
        add_to_diagonal(dual, -relaxed * dot(v, v));
      }
    }
    fresh.clear();
    eliminate(touched);
  }

  /// Whether all of a component is in the factor. Where weights are further apart than the shifts
  /// that make its proof safe against rounding, no pivots are positive, and all waits.
  bool has_factor(Index component) const {
    return std::none_of(tree_.pending().begin(), tree_.pending().end(),
                        [&](Index i) { return core_.node(i).component == component; });
  }

  /// Learns what relaxation leaves of the cost of a new edge.
  void look_back() {
    double before = 0.0, after = 0.0;
    for (const auto& [k, cost] : fresh_) {
      before += cost;
      after += tended_.graph().edge(k).cost;
    }
    fresh_.clear();
    if (before > 0.0) left_over_ = 0.5 * (left_over_ + std::min(after / before, 1.0));
  }

  /// Moves the dual of these nodes, and of all on the way to the roots, to the rotations.
  void refresh(const std::vector<Index>& nodes) {
    ++counts.refreshed;
    tree_.solve_lower(for_bound);
    tree_.detach(nodes);
    move_dual();
    eliminate({nodes.front()});
  }

  /// Newton steps, by the components that were touched, until `is_near()`, which looks at y and is
  /// told the largest relative gradient of these.
  ///
  /// Z = S_r^-1 K, and X = N - Z solves S X = 0 with X = N at the ground: the rotations nearest to
  /// the X_i^T are the next ones. With S near that of the rotations this is Newton's step to second
  /// order in the residuals; with the dual at zero it is the chordal relaxation. K is of the
  /// gradient alone: where that is zero, nothing is to move, wherever the dual is.
  /// @param gradient what is small leaves alone nodes with relative gradients up to this, at first
  /// @returns false where the objective would not fall any further
  template <typename IsNear>
  bool converge(double gradient, IsNear&& is_near) {
    constexpr int most = 100;
    const auto is_touched = [&](Index i) { return tended_.component_of(i).is_touched; };
    double least = std::numeric_limits<double>::infinity();
    for (int k = 0, without_gain = 0;; ++k) {
      tree_.solve_lower(for_step);
      relative_gradient = 0.0;
      double largest = 0.0;  // of what was touched
      tree_.for_each_root([&](Index i, const Clique& clique) {
        relative_gradient = std::max(relative_gradient, clique.gradient);
        if (is_touched(i)) largest = std::max(largest, clique.gradient);
      });
      if (largest == 0.0 || is_near(largest)) return true;
      without_gain = largest < 0.7 * least ? 0 : without_gain + 1;
      least = std::min(least, largest);
      if (k == most || without_gain > 8) return false;
      while (largest <= gradient) gradient *= 0.1;
      moved_.clear();
      tree_.solve_upper(gradient, 0.25 * gradient, is_touched,
                        [&](Index i, const Matrix3& Z) { moved_.emplace_back(i, Z); });
      if (!move()) return false;
      ++counts.iterations;
      counts.moved += static_cast<Index>(moved_.size());
    }
  }

 private:
  /// The dual of what is eliminated anew follows the rotations. How far it is off below, in sum, is
  /// made up for at the nodes that the subtree hangs from: what differences do that cancel does not
  /// reach far.
  void move_dual() {
    for (const Index i : tree_.pending()) core_.node(i).dual = core_.node(i).less;
    tree_.for_each_orphan([&](const Clique& subtree, const std::vector<Index>& above) {
      const double share = 1.0 / static_cast<double>(above.size());
      for (const Index i : above) {
        const Matrix3 R = core_.node(i).q.toRotationMatrix();
        Matrix3 off = symmetric_part(transposed_product(R, product(subtree.off, R)));
        off *= share;
        add(core_.node(i).dual, off);
      }
    });
  }

  void eliminate(const std::vector<Index>& last) {
    counts.eliminated += static_cast<Index>(tree_.pending().size());
    if (tree_.eliminate(last)) return;
    for (const Index i : tree_.pending()) core_.node(i).dual.setZero();
    if (tree_.eliminate(last)) return;
    // Where edges went, what is below may no longer do either.
    std::vector<bool> waits(tended_.components.size(), false);
    for (const Index i : tree_.pending()) waits[core_.node(i).component] = true;
    std::vector<Index> all;
    for (Index i = 0; i < tended_.graph().num_nodes(); ++i) {
      if (core_.node(i).kind != NodeKind::core || !waits[core_.node(i).component]) continue;
      all.push_back(i);
      core_.node(i).dual.setZero();
    }
    tree_.detach(all);
    tree_.eliminate(last);  // or not, with weights too far apart: see has_factor()
  }

  /// A step along Z, halved until the objective does not rise.
  bool move() {
    constexpr int max_halvings = 20;
    find_edges();
    double before = 0.0, weight = 0.0;
    for (const Index k : edges_) {
      before += tended_.graph().edge(k).cost;
      weight += tended_.graph().edge(k).weight;
    }
    const double enough = before + objective_rounding(weight, before) +
                          unit_roundoff * static_cast<double>(edges_.size()) * before;
    old_.clear();
    for (const auto& [i, Z] : moved_) old_.push_back(core_.node(i).q);
    double t = 1.0;
    for (int k = 0; k < max_halvings; ++k, t *= 0.5) {
      for (std::size_t m = 0; m < moved_.size(); ++m) {
        core_.node(moved_[m].first).q = stepped(old_[m], moved_[m].second, t);
      }
      double after = 0.0;
      for (const Index e : edges_) {
        const OnlineEdge& edge = tended_.graph().edge(e);
        after += core_.cost(e, core_.node(edge.i).q, core_.node(edge.j).q);
      }
      if (!(after <= enough)) continue;
      for (const Index e : edges_) tended_.update_edge(e);
      for (const Index i : nodes_) tended_.update_node(i);
      for (const auto& [i, Z] : moved_) turned.push_back(i);
      return true;
    }
    for (std::size_t m = 0; m < moved_.size(); ++m) core_.node(moved_[m].first).q = old_[m];
    return false;
  }

  /// The rotation nearest to (R_i^T - t Z)^T; to second order R_i exp([z]), [z] the skew part of
  /// t Z R_i.
  static Quaternion stepped(const Quaternion& q, const Matrix3& Z, double t) {
    constexpr double short_step = 1e-2;
    Matrix3 X = q.toRotationMatrix();
    if (t * Z.cwiseAbs().maxCoeff() < short_step) {
      const Vector3 z = vee_difference(product(Z, X));
      const double half = 0.5 * t;
      const Quaternion turn = exp_quaternion({half * z(0), half * z(1), half * z(2)});
      return Quaternion(product(q, turn)).normalized();
    }
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) X(r, c) -= t * Z(c, r);
    }
    return to_quaternion(nearest_rotation(X));
  }

  /// The edges of the core at what moves, and their ends.
  void find_edges() {
    const GrowingGraph& graph = tended_.graph();
    edge_seen_.resize(graph.num_edges(), 0);
    node_seen_.resize(graph.num_nodes(), 0);
    ++stamp_;
    edges_.clear();
    nodes_.clear();
    const auto see = [&](Index i) {
      if (std::exchange(node_seen_[i], stamp_) != stamp_) nodes_.push_back(i);
    };
    for (const auto& [i, Z] : moved_) {
      for (const GrowingGraph::End& end : graph.ends(i)) {
        const OnlineEdge& e = graph.edge(end.edge);
        if (!e.in_core || !(e.weight > 0.0)) continue;
        if (std::exchange(edge_seen_[end.edge], stamp_) == stamp_) continue;
        edges_.push_back(end.edge);
        see(e.i);
        see(e.j);
      }
    }
  }

  TendedCore& tended_;
  Core& core_;
  CliqueTree<Core>& tree_;
  std::vector<std::pair<Index, Matrix3>> moved_;
  std::vector<Quaternion> old_;
  std::vector<Index> edges_, nodes_;
  std::vector<std::pair<Index, double>> fresh_;  // new edges, and what they cost at first
  double left_over_ = 0.0;                       // of such costs, after relaxation
  std::vector<Index> edge_seen_, node_seen_;
  Index stamp_ = 0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

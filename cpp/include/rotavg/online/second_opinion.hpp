#pragma once

#include <algorithm>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Judging edges as they come believes those that came first. So now and then solve_robust() judges
/// all of a component at once, sooner where edges that were left out agree with one another; what
/// it finds is taken where the loss is less there.
class SecondOpinion {
 public:
  /// @param tended must outlive this object
  SecondOpinion(const TendedCore& tended, const RobustLoss& loss) : tended_(tended), loss_(loss) {}

  /// After a step.
  /// @param left_out the edges that were, in this step
  /// @param num_outliers of now
  void note(const std::vector<Index>& left_out, Index num_outliers) {
    for (const Index k : left_out) {
      agree_ = agree_ || (tended_.graph().edge(k).is_there && has_company(k));
    }
    num_outliers_ = num_outliers;
    asked_outliers_ = std::min(asked_outliers_, num_outliers);
  }

  /// Whether to ask. It takes as long as all edges do, so since it was asked more have to have been
  /// left out, by a tenth where some of them agree, by a third where they do not; and unless edges
  /// are few, or the first ones that were left out agree, one in a hundred has to be new.
  bool is_due() const {
    constexpr Index few = 200, first = 10;
    const Index edges = tended_.graph().num_edges();
    const bool is_soon = edges <= few || (agree_ && num_outliers_ <= first);
    return num_outliers_ > asked_outliers_ + asked_outliers_ / (agree_ ? 10 : 3) &&
           (is_soon || edges >= asked_edges_ + asked_edges_ / 100);
  }

  /// After it was asked.
  void has_asked(Index num_outliers) {
    agree_ = false;
    asked_edges_ = tended_.graph().num_edges();
    asked_outliers_ = num_outliers;
  }

  /// What solve_robust() leaves of the weights of the edges that the loss judges.
  /// @returns (edge, part); empty where the loss is not less for it
  std::vector<std::pair<Index, double>> ask(const OnlineComponent& component) const {
    std::vector<RelativeRotation> measurements;
    std::vector<Index> edges;
    std::vector<NodeId> rows(component.nodes.begin(), component.nodes.end());
    std::unordered_map<Index, std::size_t> row_of;
    for (std::size_t r = 0; r < rows.size(); ++r) row_of.emplace(component.nodes[r], r);
    RobustOptions robust;
    robust.loss = loss_.kind;
    robust.scale = loss_.scale;
    robust.weight_kind = WeightKind::frequency;  // as the residuals are judged here, too
    bool leaves_out = false;
    for (const Index i : component.nodes) {
      for (const GrowingGraph::End& end : tended_.graph().ends(i)) {
        const OnlineEdge& e = tended_.graph().edge(end.edge);
        if (e.i != i || !(e.given > 0.0) || row_of.count(e.j) == 0) continue;
        measurements.push_back({e.i, e.j, e.rotation(), e.given});
        leaves_out = leaves_out || e.is_left_out();
        edges.push_back(end.edge);
        robust.known.trusted.push_back(e.trusted);
      }
    }
    if (!leaves_out) return {};
    const MeasurementGraph graph(measurements, rows);
    SolveOptions options;
    options.certify = false;
    options.iteration.num_threads = 1;
    const Quaternions other = to_quaternions(solve_robust(graph, options, robust).rotations);

    std::vector<std::pair<Index, double>> parts;
    double cost_now = 0.0, cost = 0.0;
    for (std::size_t p = 0; p < edges.size(); ++p) {
      const Core& core = tended_.core;
      const Index k = edges[p], i = core.graph().edge(k).i, j = core.graph().edge(k).j;
      const double x_now = core.squared_chord(k, core.rotation(i), core.rotation(j));
      const double x = core.squared_chord(k, other[row_of.at(i)], other[row_of.at(j)]);
      const bool trusted = robust.known.trusted[p];
      cost_now += measurements[p].weight * (trusted ? x_now : loss_.rho(x_now));
      cost += measurements[p].weight * (trusted ? x : loss_.rho(x));
      if (!trusted) parts.emplace_back(k, loss_.weight(x));
    }
    constexpr double clearly = 1e-6;
    if (!(cost < (1.0 - clearly) * cost_now)) parts.clear();
    return parts;
  }

 private:
  /// Whether another edge that was left out leads from near one end to near the other, and asks for
  /// the same turn.
  bool has_company(Index k) const {
    const OnlineEdge& e = tended_.graph().edge(k);
    const std::vector<Index> near_i = nodes_near(e.i), near_j = nodes_near(e.j);
    const std::unordered_set<Index> at_j(near_j.begin(), near_j.end());
    const Quaternion turn = turn_asked(e);
    for (const Index a : near_i) {
      for (const GrowingGraph::End& end : tended_.graph().ends(a)) {
        const OnlineEdge& other = tended_.graph().edge(end.edge);
        if (end.edge == k || !other.is_left_out() || at_j.count(end.node) == 0) continue;
        const Quaternion same = turn_asked(other);
        const double off = chordal_distance(turn, other.i == a ? same : same.conjugate());
        if (0.5 * off * off < 4.0 * loss_.scale * loss_.scale) return true;
      }
    }
    return false;
  }

  /// By which what hangs from j would have to turn, in the world.
  Quaternion turn_asked(const OnlineEdge& e) const {
    const Quaternion q_i = tended_.core.rotation(e.i), q_j = tended_.core.rotation(e.j);
    return Quaternion(product(product(q_i, e.i_from_j), q_j.conjugate())).normalized();
  }

  /// The first few of a breadth-first search.
  std::vector<Index> nodes_near(Index i) const {
    constexpr std::size_t few = 60;
    std::vector<Index> nodes{i};
    std::unordered_set<Index> seen{i};
    for (std::size_t p = 0; p < nodes.size() && nodes.size() < few; ++p) {
      tended_.graph().for_each_used(nodes[p], [&](Index l, Index) {
        if (nodes.size() < few && seen.insert(l).second) nodes.push_back(l);
      });
    }
    return nodes;
  }

  const TendedCore& tended_;
  RobustLoss loss_;
  bool agree_ = false;  // edges that were left out since it was asked
  Index num_outliers_ = 0, asked_edges_ = 0, asked_outliers_ = 0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

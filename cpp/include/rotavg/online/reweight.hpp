#pragma once

#include <algorithm>
#include <cmath>
#include <unordered_set>
#include <utility>
#include <vector>

#include <rotavg/online/optimum.hpp>
#include <rotavg/online/tended_core.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The weights in use: those that were given, times what a robust loss leaves of them.
class OnlineWeights {
 public:
  /// @param tended must outlive this object
  OnlineWeights(TendedCore& tended, const RobustLoss& loss) : tended_(tended), loss_(loss) {}

  Index num_outliers = 0;
  std::vector<Index> left_out;  ///< edges that were, since this was cleared

  void append_left_out(const std::vector<Index>& edges) {
    for (const Index k : edges) {
      if (is_outlier(k)) left_out.push_back(k);
    }
  }

  bool is_outlier(Index k) const { return tended_.graph().edge(k).is_left_out(); }

  /// Whether the rotations of now leave the weights of these edges as they are, and of those at
  /// nodes that are in another component than before.
  bool would_stay(std::vector<Index> edges) const {
    append_edges_at(tended_.parted, edges);
    return std::all_of(edges.begin(), edges.end(), [&](Index k) {
      return !is_judged(k) ||
             (is_within_component(k) && !differs(k, loss_.weight(squared_chord(k))));
    });
  }

  /// Whether the loss judges a new edge that closes a cycle before it is used.
  bool is_foretold(Index k) const {
    const OnlineEdge& e = tended_.graph().edge(k);
    return loss_.kind != Loss::l2 && !e.trusted && e.given > 0.0;
  }

  /// What the loss leaves of the weight of such an edge. The truncated loss leaves out those of
  /// which it is proved, to rounding, that they would cost more than that.
  double foretold_part(Index k, OnlineOptimum& optimum) const {
    constexpr double largest = 4.0;        // r^2 of half a turn
    constexpr double margin = 1.0 + 1e-9;  // for the rounding of what is foretold
    const OnlineEdge& e = tended_.graph().edge(k);
    const auto closing = optimum.foretell(e);
    if (!closing) return 1.0;
    if (loss_.kind != Loss::tls) return loss_.weight(closing->squared_chord);
    return closing->least_cost > margin * 2.0 * e.given * loss_.rho(largest) ? 0.0 : 1.0;
  }

  void use_weight(Index k, double weight) {
    const bool was_used = tended_.graph().edge(k).weight > 0.0;
    if (was_used && !(weight > 0.0)) {
      tended_.drop(k, false);
    } else if (was_used) {
      tended_.set_weight(k, weight);
    } else if (weight > 0.0) {
      tended_.core.graph().set_weight(k, weight);
      tended_.use(k);
    }
  }

  /// One round of reweighting. Of the truncated loss the edge that is furthest beyond the scale
  /// goes, alone, for the others may be there because of it; and those come back that the rotations
  /// of now agree with, and those between components, as no other edge in use contradicts them.
  /// Others get the weights of their residuals.
  /// @param edges those that are new; receives those at nodes that have moved, or are in another
  ///        component
  /// @returns whether a weight has changed
  bool operator()(std::vector<Index>& turned, std::vector<Index>& edges,
                  std::unordered_set<Index>& dropped, std::unordered_set<Index>& pardoned) {
    for (std::vector<Index>* nodes : {&turned, &tended_.parted}) {
      append_edges_at(*nodes, edges);
      nodes->clear();
    }
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    const bool truncated = loss_.kind == Loss::tls;
    std::vector<std::pair<Index, double>> parts;
    double worst = 0.0;
    Index furthest = -1;
    for (const Index k : edges) {
      const OnlineEdge& e = tended_.graph().edge(k);
      if (!is_judged(k)) continue;
      if (!is_within_component(k)) {
        if (pardoned.insert(k).second) parts.emplace_back(k, 1.0);
        continue;
      }
      const double x = squared_chord(k), part = loss_.weight(x);
      if (truncated && part == 0.0 && e.weight > 0.0) {
        if (x > worst && dropped.count(k) == 0 && !tended_.is_bridge(k)) {
          worst = x;
          furthest = k;
        }
      } else if (differs(k, part)) {
        if (!truncated || pardoned.insert(k).second) parts.emplace_back(k, part);
      }
    }
    if (furthest >= 0) {
      dropped.insert(furthest);
      parts.emplace_back(furthest, 0.0);
    }
    use_parts(parts);
    return !parts.empty();
  }

  /// Other weights, as parts of those that were given: what grows first, or the graph falls apart
  /// for a while.
  void take(std::vector<std::pair<Index, double>> parts) {
    const auto grows = [&](const std::pair<Index, double>& of) {
      const OnlineEdge& e = tended_.graph().edge(of.first);
      return of.second * e.given > e.weight;
    };
    std::stable_partition(parts.begin(), parts.end(), grows);
    parts.erase(std::remove_if(parts.begin(), parts.end(),
                               [&](const auto& of) { return !differs(of.first, of.second); }),
                parts.end());
    use_parts(parts);
  }

  /// Other weights, as parts of those that were given.
  void use_parts(const std::vector<std::pair<Index, double>>& parts) {
    for (const auto& [k, part] : parts) {
      const bool was_outlier = is_outlier(k);
      use_weight(k, part * tended_.graph().edge(k).given);
      num_outliers += is_outlier(k) - was_outlier;
      if (is_outlier(k) && !was_outlier) left_out.push_back(k);
    }
  }

 private:
  /// The edges at these nodes, and at what hangs from them.
  void append_edges_at(const std::vector<Index>& nodes, std::vector<Index>& edges) const {
    for (const Index i : nodes) {
      for (const Index l : hanging_tree(tended_.core, i)) {
        for (const GrowingGraph::End& end : tended_.graph().ends(l)) edges.push_back(end.edge);
      }
    }
  }
  /// Whether the loss has a say: an edge that nothing checks is left alone.
  bool is_judged(Index k) const {
    const OnlineEdge& e = tended_.graph().edge(k);
    const bool hangs = e.weight > 0.0 && !e.in_core;
    return e.is_there && !e.trusted && e.given > 0.0 && !hangs;
  }
  bool is_within_component(Index k) const {
    const OnlineEdge& e = tended_.graph().edge(k);
    return tended_.core.node(e.i).component == tended_.core.node(e.j).component;
  }
  /// Whether an edge's weight is to be another part of what was given.
  bool differs(Index k, double part) const {
    constexpr double coarse = 1e-3;
    const OnlineEdge& e = tended_.graph().edge(k);
    return std::abs(part - e.weight / e.given) > coarse;
  }

  double squared_chord(Index k) const {
    const OnlineEdge& e = tended_.graph().edge(k);
    return tended_.core.squared_chord(k, tended_.core.rotation(e.i), tended_.core.rotation(e.j));
  }

  TendedCore& tended_;
  RobustLoss loss_;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

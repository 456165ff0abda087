#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

namespace detail {
class OnlineEngine;
}

struct OnlineOptions {
  /// f(R) - f*, as a part of f, below 1: how near to the optimum the rotations are after every
  /// step. Changes that are proved to gain less wait for others: with 1e-2, most do.
  double tolerance = 1e-10;
  /// Largest relative gap that is called optimal; `tolerance`, where that is larger.
  double certificate_tolerance = 1e-6;
  /// Of edges that are not trusted; Loss::automatic is none of those that can be used here.
  Loss loss = Loss::l2;
  /// c of RobustLoss, radians; to be given with any loss but l2.
  double loss_scale = 0.0;
  /// Whether solve_robust() judges all edges at once now and then (second_opinion.hpp): a step that
  /// takes as long as that does.
  bool second_opinions = true;
};

/// How things stand after a step.
struct OnlineState {
  Verdict verdict = Verdict::proved;
  double objective = 0.0;          ///< f(R), with the weights in use
  double gap = 0.0;                ///< f(R) - f* <= gap
  double relative_gap = 0.0;       ///< the worst of the components
  double relative_gradient = 0.0;  ///< the largest, without what waits; hanging edges have none
  Index num_nodes = 0, num_edges = 0, num_components = 0;
  Index num_outliers = 0;  ///< edges that the loss leaves less than half their weight
  // Of the last step:
  int iterations = 0;           ///< Newton steps
  Index eliminated = 0;         ///< nodes whose columns of the factor were made anew
  Index moved = 0;              ///< nodes that were turned, counted once an iteration
  int refreshed = 0;            ///< times that the dual was moved to the rotations
  int solved = 0;               ///< times that solve() was called
  int num_second_opinions = 0;  ///< times that solve_robust() judged all edges at once
};

/// Rotation averaging while data come in: edges and nodes are added, removed and reweighted, and
/// after every call the rotations are those of the optimum, to the tolerance, and what is proved of
/// them is known.
///
/// docs/online.md has the mathematics. In short: an edge to a new node costs nothing and leaves the
/// proof as it is. An edge that closes a cycle changes the Cholesky factor of the certificate's
/// matrix on the way from its ends to the root, and with that factor some Newton steps are made, by
/// the nodes that move. y = L^-1 K, kept up on the way, bounds the gap by |y|^2 without a further
/// factorisation: the factor need not be that of the last rotations to be a proof.
///
/// All functions that change the graph check everything first, and change nothing where they throw.
class Online {
 public:
  explicit Online(const OnlineOptions& options = {});
  ~Online();
  Online(Online&&) noexcept;
  Online& operator=(Online&&) noexcept;

  /// Adds edges, with nodes where they are new. A weight of 0 keeps an edge unused.
  /// @param trusted of every edge, whether a robust loss leaves it alone; empty: none is. (An edge
  ///        that joins two components is not touched either, while nothing checks it.)
  /// @param nodes ids that are to be there whether or not an edge has them, before those of the
  /// edges
  /// @returns the numbers of the edges: 0 for the first that was ever added, and so on
  /// @throws InvalidEdge for a measurement that check_measurement refuses
  /// @throws std::invalid_argument if `trusted` has another size
  std::vector<Index> add(const std::vector<RelativeRotation>& edges,
                         const std::vector<bool>& trusted = {},
                         const std::vector<NodeId>& nodes = {});

  /// Removes edges for good; nodes stay.
  /// @throws InvalidEdge for a number that is none of an edge, or stands twice
  void remove(const std::vector<Index>& edges);

  /// Gives edges other weights.
  /// @throws InvalidEdge as remove(), and for a weight that is neither 0 nor one of a graph
  /// @throws std::invalid_argument unless there is one weight for each edge
  void set_weights(const std::vector<Index>& edges, const std::vector<double>& weights);

  const OnlineState& state() const;
  /// In the order in which they came.
  const std::vector<NodeId>& nodes() const;
  /// world_from_i of all nodes, the identity at the first node of every component.
  Rotations rotations() const;
  /// world_from_i of one node, in the gauge in which only what moves changes: the identity at a
  /// node of every component, not always its first.
  /// @throws std::invalid_argument for an id that is not there
  Matrix3 rotation(NodeId node) const;
  /// (of all edges ever added) the weights in use, with what a robust loss leaves of them; 0 of
  /// edges that were removed
  std::vector<double> edge_weights() const;
  /// The edges that are there, as they were given.
  /// @param numbers receives their numbers
  std::vector<RelativeRotation> edges(std::vector<Index>& numbers) const;

 private:
  std::unique_ptr<detail::OnlineEngine> impl_;
};

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/online/online_impl.hpp>
#endif

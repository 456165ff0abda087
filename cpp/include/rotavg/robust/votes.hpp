#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Lets the neighbours of every node vote on its rotation: it takes that of its neighbours'
/// estimates R_q R_ql which has the least robust cost among all of them, if that is clearly less
/// than its own. Reweighted least squares move a node by small steps, and leave it where a few
/// wrong edges hold it; this moves it straight to where most agree. The robust objective never
/// rises.
///
/// @param weights (m,) of the edges; those in the graph are not used
/// @param precision (m,) in whose units the residuals are judged; empty: all 1
/// @param loss bounded, as geman_mcclure: a node with more than half of its weight on edges that
///        it agrees with is left alone, since no other rotation can do better
/// @param q world_from_i, changed in place, node after node
/// @param open (n,) which nodes are looked at: in the end, those with a neighbour that has moved
/// @param keep_going asked every few milliseconds; false stops
/// @returns how many nodes moved
inline Index vote_sweep(const MeasurementGraph& graph, const std::vector<double>& weights,
                        const std::vector<double>& precision, const RobustLoss& loss,
                        Quaternions& q, std::vector<bool>& open,
                        const std::function<bool()>& keep_going = {}) {
  constexpr Index max_candidates = 48, estimates_between_questions = 20000;
  constexpr double clearly = 0.999;
  std::vector<Vector4> estimates;
  std::vector<double> w, p;
  Index moved = 0, looked_at = 0;
  for (Index l = 0; l < graph.num_nodes(); ++l) {
    const auto row = graph.row(l);
    const Index degree = row.size();
    if (degree < 3 || !open[l]) continue;
    open[l] = false;
    looked_at += std::min(degree, estimates_between_questions);
    if (looked_at >= estimates_between_questions && keep_going && !keep_going()) break;
    looked_at %= estimates_between_questions;
    estimates.clear();
    w.clear();
    p.clear();
    double most = 0.0;
    for (const HalfEdge& h : row) {
      estimates.push_back(product(q[h.node], h.node_from_l).normalized());
      w.push_back(weights[h.edge()]);
      p.push_back(precision_of(precision, h.edge()));
      most += w.back() * loss.rho(4.0, p.back());
    }
    // r^2 = 4 (1 - s^2) for the cosine s of the angle between two quaternions
    const auto cost = [&](const Vector4& at) {
      double sum = 0.0;
      for (Index k = 0; k < degree; ++k) {
        const double s = at.dot(estimates[k]);
        sum += w[k] * loss.rho(std::max(0.0, 4.0 * (1.0 - s * s)), p[k]);
      }
      return sum;
    };
    double least = cost(q[l].coeffs());
    if (least < 0.5 * most) continue;
    least *= clearly;
    const Index stride = (degree + max_candidates - 1) / max_candidates;
    Index best = -1;
    for (Index k = l % stride; k < degree; k += stride) {
      const double cost_k = cost(estimates[k]);
      if (cost_k < least) {
        least = cost_k;
        best = k;
      }
    }
    if (best < 0) continue;
    q[l] = Quaternion(estimates[best]);
    ++moved;
    for (const HalfEdge& h : row) open[h.node] = true;
  }
  return moved;
}

/// Some sweeps of votes, while nodes move.
/// @param keep_going asked every few milliseconds; false stops
/// @returns how many moved, each as often as it did
inline Index take_votes(const MeasurementGraph& graph, const std::vector<double>& weights,
                        const std::vector<double>& precision, const RobustLoss& loss, Rotations& R,
                        const std::function<bool()>& keep_going = {}) {
  constexpr int max_sweeps = 3;
  Quaternions q = to_quaternions(R);
  std::vector<bool> open(q.size(), true);
  Index moved = 0;
  for (int k = 0; k < max_sweeps && (!keep_going || keep_going()); ++k) {
    const Index now = vote_sweep(graph, weights, precision, loss, q, open, keep_going);
    moved += now;
    if (now == 0) break;
  }
  R = to_rotations(q, R);
  return moved;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/stations.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// How many things must have gone wrong if rotations are right, where some edges are odometry.
///
/// A loss counts edges. But closures are made by recognising places, and a place taken for another
/// makes many that agree: of rejected closures those that lead from one neighbourhood to another
/// and ask for the same turn count as one, and a tenth for each further one. A step of odometry
/// goes wrong by itself, and so does an edge between nodes near by along the odometry; a step
/// counts twice, unless more than three in a hundred are rejected.
///
/// @param odometry (m,)
/// @param noise radians, of an edge of precision 1
inline double mishaps(RobustRun& run, const MeasurementGraph& graph, const Rotations& R,
                      const std::vector<bool>& odometry, double noise) {
  constexpr Index near = 5, local = 10;  // steps
  constexpr double further_one = 0.1, seldom = 0.03, of_seldom = 2.0;
  const std::vector<double> x = run.squared_residuals_at(R);
  const std::vector<double>& precision = run.free_precision();
  const std::vector<Station> at = stations(graph, odometry, precision);
  const double outlier = outlier_noises * outlier_noises * noise * noise;
  struct Closure {
    const Station *from, *to;
    Matrix3 turn;  // world
    double variance;
  };
  std::vector<Closure> closures;
  double steps = 0.0, rejected_steps = 0.0, singly = 0.0;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    const double p = precision_of(precision, k);
    const bool rejected = x[k] * p > outlier;
    steps += odometry[k];
    rejected_steps += odometry[k] && rejected;
    if (!rejected || odometry[k]) continue;
    const Edge& e = graph.edges()[k];
    const Station *from = &at[e.i], *to = &at[e.j];
    if (from->walk == to->walk && std::abs(from->place - to->place) <= local) {
      singly += 1.0;
      continue;
    }
    Matrix3 turn = R[e.i] * e.i_from_j() * R[e.j].transpose();
    const auto place = [](const Station* s) { return std::pair(s->walk, s->place); };
    if (place(to) < place(from)) {
      std::swap(from, to);
      turn.transposeInPlace();
    }
    closures.push_back({from, to, turn, 1.0 / p});
  }
  std::sort(closures.begin(), closures.end(), [](const Closure& a, const Closure& b) {
    return std::pair(a.from->walk, a.from->place) < std::pair(b.from->walk, b.from->place);
  });
  std::vector<std::size_t> group(closures.size());
  std::iota(group.begin(), group.end(), std::size_t{0});
  const auto first_of = [&](std::size_t c) {
    while (group[c] != c) c = group[c] = group[group[c]];
    return c;
  };
  double groups = static_cast<double>(closures.size());
  for (std::size_t a = 0; a < closures.size(); ++a) {
    for (std::size_t b = a + 1; b < closures.size(); ++b) {
      const Closure &one = closures[a], &other = closures[b];
      if (other.from->walk != one.from->walk || other.from->place > one.from->place + near) break;
      if (other.to->walk != one.to->walk || std::abs(other.to->place - one.to->place) > near) {
        continue;
      }
      // A chord r of two rotations: |.|_F^2 = 2 r^2.
      const double r2 = 0.5 * (one.turn - other.turn).squaredNorm();
      if (r2 > outlier * (one.variance + other.variance)) continue;
      const std::size_t A = first_of(a), B = first_of(b);
      if (A == B) continue;
      group[B] = A;
      groups -= 1.0;
    }
  }
  const double agreeing = static_cast<double>(closures.size()) - groups;
  const double a_step = rejected_steps <= seldom * steps ? of_seldom : 1.0;
  return a_step * rejected_steps + singly + groups + further_one * agreeing;
}

/// Whether rotations bend a step of odometry further than noise does, or the noise is so coarse
/// that nothing shows.
inline bool bends_odometry(RobustRun& run, const Rotations& R, const std::vector<bool>& odometry,
                           double noise) {
  constexpr double coarse = 0.1, noises = 5.0;
  if (noise > coarse) return true;
  const std::vector<double>& x = run.squared_residuals_at(R);
  const double most = noises * noises * noise * noise;
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (odometry[k] && x[k] * precision_of(run.free_precision(), k) > most) return true;
  }
  return false;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

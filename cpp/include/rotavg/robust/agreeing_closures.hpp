#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Where a node is along the odometry that reaches it.
struct Station {
  Index walk = -1;        ///< the first node of that odometry
  double variance = 0.0;  ///< of the way from there, in units of the noise's
  Matrix3 walk_from_node = Matrix3::Identity();
};

/// The nodes along each walk, from one of its ends where it has any.
/// @param precision (m,), or empty: all 1
inline std::vector<Station> stations(const MeasurementGraph& graph,
                                     const std::vector<bool>& odometry,
                                     const std::vector<double>& precision) {
  const Index n = graph.num_nodes();
  std::vector<Index> degree(n, 0), waiting;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (!odometry[k]) continue;
    ++degree[graph.edges()[k].i];
    ++degree[graph.edges()[k].j];
  }
  std::vector<Station> at(n);
  const auto walk_from = [&](Index first) {
    if (at[first].walk >= 0) return;
    at[first].walk = first;
    waiting.assign(1, first);
    while (!waiting.empty()) {
      const Index i = waiting.back();
      waiting.pop_back();
      for (const HalfEdge& h : graph.row(i)) {
        if (!odometry[h.edge()] || at[h.node].walk >= 0) continue;
        const Edge& e = graph.edges()[h.edge()];
        at[h.node].walk = first;
        at[h.node].variance = at[i].variance + 1.0 / precision_of(precision, h.edge());
        at[h.node].walk_from_node = along_edge(e, at[i].walk_from_node, h.node);
        waiting.push_back(h.node);
      }
    }
  };
  for (Index i = 0; i < n; ++i) {
    if (degree[i] == 1) walk_from(i);
  }
  for (Index i = 0; i < n; ++i) walk_from(i);
  return at;
}

}  // namespace detail

/// Of the edges the odometry, and closures that agree with another near by: with the odometry
/// between their ends the two make a cycle that closes. Closures that are wrong at random hardly
/// ever do; right ones do wherever the odometry between two of them is right, whatever it is
/// elsewhere. (That consistency of pairs is what Mangelson et al., ICRA 2018, maximise.)
///
/// @param odometry (m,)
/// @param precision (m,), or empty: all 1
/// @param noise radians, of an edge of precision 1
/// @returns (m,) which
inline std::vector<bool> agreeing_closures(const MeasurementGraph& graph,
                                           const std::vector<bool>& odometry,
                                           const std::vector<double>& precision, double noise) {
  constexpr double telling = 0.2;  // radians: a deviation that chance hardly meets
  constexpr std::size_t most_neighbours = 200;
  const std::vector<detail::Station> at = detail::stations(graph, odometry, precision);
  struct Closure {
    Index edge;
    const detail::Station *from, *to;
    double variance;
    Matrix3 from_to;  // of the walks
  };
  std::vector<Closure> closures;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (odometry[k]) continue;
    const Edge& e = graph.edges()[k];
    const detail::Station *from = &at[e.i], *to = &at[e.j];
    Matrix3 i_from_j = e.i_from_j();
    const auto place = [](const detail::Station* s) { return std::pair(s->walk, s->variance); };
    if (place(to) < place(from)) {
      std::swap(from, to);
      i_from_j.transposeInPlace();
    }
    closures.push_back({k, from, to, 1.0 / precision_of(precision, k),
                        from->walk_from_node * i_from_j * to->walk_from_node.transpose()});
  }
  std::sort(closures.begin(), closures.end(), [](const Closure& a, const Closure& b) {
    return std::tuple(a.from->walk, a.from->variance, a.edge) <
           std::tuple(b.from->walk, b.from->variance, b.edge);
  });
  std::vector<bool> chosen = odometry;
  const double unit = noise * noise;
  for (std::size_t a = 0; a < closures.size(); ++a) {
    const Closure& one = closures[a];
    const std::size_t end = std::min(closures.size(), a + 1 + most_neighbours);
    for (std::size_t b = a + 1; b < end; ++b) {
      const Closure& other = closures[b];
      if (other.from->walk != one.from->walk || other.to->walk != one.to->walk) continue;
      const double along = other.from->variance - one.from->variance;
      if (along * unit > telling * telling) break;
      const double variance =
          one.variance + other.variance + along + std::abs(other.to->variance - one.to->variance);
      if (variance * unit > telling * telling) continue;
      const double most = outlier_noises * outlier_noises * variance * unit;
      // A chord r of two rotations: |.|_F^2 = 2 r^2.
      if ((one.from_to - other.from_to).squaredNorm() > 2.0 * most) continue;
      chosen[one.edge] = chosen[other.edge] = true;
    }
  }
  return chosen;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

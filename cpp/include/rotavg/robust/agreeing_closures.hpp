#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/stations.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

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
  const std::vector<Station> at = stations(graph, odometry, precision);
  struct Closure {
    Index edge;
    const Station *from, *to;
    double variance;
    Matrix3 from_to;  // of the walks
  };
  std::vector<Closure> closures;
  for (Index k = 0; k < graph.num_edges(); ++k) {
    if (odometry[k]) continue;
    const Edge& e = graph.edges()[k];
    const Station *from = &at[e.i], *to = &at[e.j];
    Matrix3 i_from_j = e.i_from_j();
    const auto place = [](const Station* s) { return std::pair(s->walk, s->variance); };
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

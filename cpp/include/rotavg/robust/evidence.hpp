#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// Which of two answers the edges speak for.
///
/// Edges that agree on a wrong answer are no independent witnesses: one facade that looks like
/// another makes hundreds of them. So their number says little. What says more is that a camera's
/// nearest neighbours, with whom it shares most, are hardly ever confused: what only looks alike
/// shares less. Every camera therefore has eight voices, which its eight strongest edges have, and
/// all voices count the same. Strength is weight times overlap (Neighbourhoods), so that edges that
/// are wrong at random, whatever their weight, have none.
class Evidence {
 public:
  /// What two answers explain that the other one does not.
  struct Comparison {
    double voices = 0.0, other_voices = 0.0;
    Index edges = 0, other_edges = 0;

    /// By how many standard deviations of chance the voices prefer the first.
    double lead() const {
      const double all = voices + other_voices;
      return all > 0.0 ? (voices - other_voices) / std::sqrt(all) : 0.0;
    }
  };

  /// @param strength (m,) of the edges
  Evidence(const MeasurementGraph& graph, const std::vector<double>& strength)
      : voices_(strength.size(), 0.0) {
    constexpr std::ptrdiff_t voices_of_a_camera = 8;
    std::vector<std::pair<double, Index>> strongest;
    for (Index l = 0; l < graph.num_nodes(); ++l) {
      strongest.clear();
      for (const HalfEdge& h : graph.row(l)) strongest.emplace_back(-strength[h.edge()], h.edge());
      const auto count =
          std::min<std::ptrdiff_t>(voices_of_a_camera, static_cast<std::ptrdiff_t>(strongest.size()));
      std::partial_sort(strongest.begin(), strongest.begin() + count, strongest.end());
      for (std::ptrdiff_t k = 0; k < count; ++k) voices_[strongest[k].second] += 1.0;
    }
  }

  /// (m,) how many voices every edge has: 0, 1 or 2.
  const std::vector<double>& voices() const { return voices_; }

  /// @param x, other squared residuals (m,) in units of the noise: an edge is explained by an answer
  ///        if they are clearly smaller, by half of the sixteen up to which they count
  Comparison compare(const std::vector<double>& x, const std::vector<double>& other) const {
    constexpr double most = 16.0;
    Comparison c;
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double gain = std::min(other[k], most) - std::min(x[k], most);
      if (gain > 0.5 * most) {
        c.voices += voices_[k];
        ++c.edges;
      } else if (gain < -0.5 * most) {
        c.other_voices += voices_[k];
        ++c.other_edges;
      }
    }
    return c;
  }

 private:
  std::vector<double> voices_;
};

}  // namespace rotavg

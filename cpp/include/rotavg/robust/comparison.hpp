#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// The squared residual, in units of the noise, from which on an edge contradicts an answer, and up
/// to which it counts.
constexpr double contradiction = 16.0;

/// What two answers explain that the other one does not.
class Comparison {
 public:
  std::vector<Index> only_first, only_other;  ///< edges
  double voices = 0.0, other_voices = 0.0;    ///< theirs

  Index edges() const { return static_cast<Index>(only_first.size()); }
  Index other_edges() const { return static_cast<Index>(only_other.size()); }

  double in_weight = 0.0;  ///< lead_in_weight()

  /// By how many standard deviations of chance the weights prefer the first: those of the edges
  /// that only it explains are greater (relative_weights, in logarithms),
  double lead_in_weight() const { return in_weight; }
  /// by how many the voices do,
  double lead_in_voices() const { return lead(voices, other_voices); }
  /// and by how many all edges do.
  double lead_in_number() const { return lead(edges(), other_edges()); }
  /// And by how many the share of its edges' ends that have a voice is the greater: z of two
  /// proportions. Like things make many edges, hardly any with a voice.
  double lead_in_strength() const {
    const double ends = 2.0 * edges(), other_ends = 2.0 * other_edges();
    const double share = (voices + other_voices) / std::max(1.0, ends + other_ends);
    if (ends == 0.0 || other_ends == 0.0 || share == 0.0 || share == 1.0) return 0.0;
    return (voices / ends - other_voices / other_ends) /
           std::sqrt(share * (1.0 - share) * (1.0 / ends + 1.0 / other_ends));
  }
  /// That of the weights if it is nothing that chance makes, and of the voices if not.
  double lead() const { return std::abs(in_weight) > chance ? in_weight : lead_in_voices(); }
  /// Whether the first is the better one. Its lead is nothing that chance makes; or it tends to
  /// that, and either the number of edges does, too, or the edges of the other have hardly a voice.
  /// (That tells nothing beside a handful, to whose voices an answer was fitted.) But against the
  /// voices a few edges do not win by what they weigh.
  bool clear() const {
    constexpr double tendency = 1.5, hardly = 0.2;
    constexpr Index few = 20, handful = 10;
    if (std::min(edges(), other_edges()) < few && lead_in_voices() < -tendency) return false;
    const bool voiceless =
        edges() >= handful && other_voices * edges() < hardly * voices * other_edges();
    return lead() > chance || (lead() > tendency && (lead_in_number() > tendency ||
                                                     (voiceless && lead_in_strength() > chance)));
  }

 private:
  /// One of a thousand for a comparison, so about one of a hundred for the dozen of starts that
  /// are compared.
  static constexpr double chance = 3.0;
  static double lead(double a, double b) { return a + b > 0.0 ? (a - b) / std::sqrt(a + b) : 0.0; }
};

}  // namespace rotavg

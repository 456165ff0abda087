#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/sides.hpp>
#include <rotavg/robust/turn_odds.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Turns sides that a single edge holds, with which none of those that contradict it agrees, as one
/// of them says: the edges alone would leave it to chance which is right. It is the one that turns
/// as right edges do (TurnOdds). If none does, all are wrong, each by about what it turns: then the
/// one that turns least does the least harm.
///
/// @param x, precision, threshold, R as of take_part_votes
/// @param tolerance a chord up to which edges agree, if their noise allows for no more
/// @returns how many sides were turned; none lies within another
inline Index take_likely_turns(const MeasurementGraph& graph, const std::vector<double>& precision,
                               const std::vector<double>& x, double threshold, double tolerance,
                               Rotations& R) {
  // In logarithms of odds: less would turn what is right about as often as what is wrong.
  constexpr double clearly = 1.5;
  constexpr double incredible = -2.0, less = 0.25, thresholds = 2.0;
  const detail::Sides sides = detail::sides_of(graph, precision, x, threshold, R);
  const auto& ballots = sides.ballots;
  if (std::all_of(ballots.begin(), ballots.end(), [](const auto& of) { return of.empty(); })) {
    return 0;
  }
  const TurnOdds odds(graph, sides.checked, sides.left_out);
  const auto agree = [&](const Matrix3& at, const detail::Ballot& b) {
    return squared_chord(at, b.turn) <=
           std::max(tolerance * tolerance, thresholds * thresholds * b.most2);
  };
  // Edges that agree add up, if any of them speaks for their turn at all.
  const auto together = [&](const std::vector<detail::Ballot>& cast, const detail::Ballot& with) {
    double best = odds(with.edge), sum = std::max(0.0, best);
    for (const detail::Ballot& b : cast) {
      if (b.edge == with.edge || !agree(with.turn, b)) continue;
      best = std::max(best, odds(b.edge));
      sum += std::max(0.0, odds(b.edge));
    }
    return best > 0.0 ? sum : best;
  };
  return detail::turn_sides(sides, R, [&](Index side, Matrix3& turn) {
    const std::vector<detail::Ballot>& cast = sides.ballots[side];
    const Index holder = sides.holder[side];
    const bool trusted = !(precision_of(precision, holder) > 0.0);
    const bool alone = std::none_of(cast.begin(), cast.end(), [&](const detail::Ballot& b) {
      return agree(Matrix3::Identity(), b);
    });
    if (trusted || !alone) return false;
    const double held = odds(holder);
    double most = held + clearly, least = odds.turn(holder) - less;
    bool likely = false, turned = false;
    const std::size_t stride = detail::stride_of(cast);
    for (std::size_t k = 0; k < cast.size(); k += stride) {
      const double now = together(cast, cast[k]), angle = odds.turn(cast[k].edge);
      const bool likelier = now > most;
      const bool harmless = !likely && held < incredible && now >= held - clearly && angle < least;
      if (!likelier && !harmless) continue;
      if (likelier) {
        most = now;
        likely = true;
      } else {
        least = angle;
      }
      turn = cast[k].turn;
      turned = true;
    }
    return turned;
  });
}

}  // namespace rotavg

#pragma GCC diagnostic pop

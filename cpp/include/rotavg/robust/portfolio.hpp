#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/robust/agreeing_turns.hpp>
#include <rotavg/robust/evidence.hpp>
#include <rotavg/robust/neighbourhoods.hpp>
#include <rotavg/robust/relative_weights.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/story_search.hpp>
#include <rotavg/robust/strongest.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// From what overlap (m,) on edges are coherent: their neighbourhoods overlap as if they were
/// right.
inline double coherent_from(std::vector<double> overlap) {
  constexpr double of_median = 0.2;
  const auto middle = overlap.begin() + static_cast<std::ptrdiff_t>(overlap.size() / 2);
  std::nth_element(overlap.begin(), middle, overlap.end());
  return of_median * *middle;
}

/// Keys (m,) of a tree that takes edges first which an answer rejects, though they are coherent;
/// empty if these are few.
inline std::vector<double> rejected_and_coherent(const std::vector<double>& x,
                                                 const std::vector<double>& overlap) {
  constexpr double many = 0.02, first = 1e3;
  const double least = coherent_from(overlap);
  std::vector<double> key = overlap;
  std::size_t found = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (x[k] <= contradiction || overlap[k] < least) continue;
    key[k] *= first;
    ++found;
  }
  if (static_cast<double>(found) < many * static_cast<double>(x.size())) key.clear();
  return key;
}

/// Whether many of the coherent edges are rejected, and weigh hardly less than those that were
/// kept: what only looks alike matches less than true neighbours do, and an answer that rejects
/// what weighs as much may well be the folded one. Less by two thirds of a standard deviation, in
/// logarithms, is hardly less; of answers that are right it is one to two.
///
/// @param relative (m,) relative_weights; empty where all weights are the same, which tell nothing
inline bool weigh_hardly_less(const std::vector<double>& x, const std::vector<double>& overlap,
                              const std::vector<double>& relative) {
  constexpr double many = 0.1, hardly = 2.0 / 3.0;
  const double least = coherent_from(overlap);
  struct Moments {
    double count = 0.0, sum = 0.0, squares = 0.0;
    double mean() const { return sum / count; }
    double variance() const { return squares / count - mean() * mean(); }
  } kept, rejected;
  for (std::size_t k = 0; k < relative.size(); ++k) {
    if (overlap[k] < least) continue;
    Moments& of = x[k] > contradiction ? rejected : kept;
    const double log_weight = std::log(relative[k]);
    of.count += 1.0;
    of.sum += log_weight;
    of.squares += log_weight * log_weight;
  }
  if (rejected.count == 0.0 || rejected.count < many * (kept.count + rejected.count)) return false;
  if (kept.count == 0.0) return true;
  const double deviation = std::sqrt(std::max(0.0, 0.5 * (kept.variance() + rejected.variance())));
  return kept.mean() - rejected.mean() <= hardly * deviation;
}

/// The voices (m,) of edges where nodes vote: those of the strongest; who has none of them votes,
/// too.
/// @param ends of strongest()
inline std::vector<double> ballots_of(std::vector<double> ends) {
  for (double& end : ends) end = 0.5 * end + 1e-3;
  return ends;
}

/// The strongest edges by some weights, all (m,).
struct Strongest {
  std::vector<double> overlap, strength;
  std::vector<double> ends, ballots;  ///< of strongest() and ballots_of()
};

inline std::vector<double> times(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t k = 0; k < a.size(); ++k) a[k] *= b[k];
  return a;
}

}  // namespace detail

/// What is known of a trajectory's answers before others are looked for.
struct TrajectoryStories {
  std::optional<Rotations> grown;     ///< where edges that bear one another out have led
  std::optional<Rotations> given_up;  ///< an answer that was found, and not preferred
  std::vector<bool> odometry;         ///< (m,), or empty
};

/// Compares what least squares and l1 have found with where other starts lead.
///
/// 1. Where hardly any edge contradicts, none of those that do agree with one another on a turn
///    (agreeing_turns), and the noise is small enough to tell, there is but one story, and nothing
///    more is done. Nor is it where hardly any of the strongest edges contradicts (Evidence). Where
///    edges that bear one another out were a start and hardly any edges share neighbours, as on a
///    trajectory, there is no evidence to compare by: a few starts are tried, and the least
///    objective decides (choose_by_cost).
/// 2. The maximum spanning tree by strength (shared_strongest) is polished, and, where weights
///    differ, that by the strength which relative weights give. If they tell the same story, that
///    is it.
/// 3. While that is doubtful: l1 on the strongest edges alone, of either kind, the trees by
///    relative weight and overlap, by what the strongest of the strongest share, by weight and
///    overlap, by weight alone, and by what the strongest edges say that the best answer rejects.
///    Where weights differ and many coherent edges are rejected, doubtful or not, the tree of the
///    edges strongest whatever they weigh, and l1 on these.
/// 4. What the rejected edges would say, if many of them are coherent or some agree on a turn. Of
///    parts that a single edge holds the best answer takes the likely place (take_likely_turns),
///    also where 1. ends the search; other places are further answers (other_places).
/// 5. What the evidence does not rule out is an alternative; and where many of the coherent edges
///    are rejected and weigh hardly less than the others (weigh_hardly_less), every other answer.
///
/// @param run that judges residuals in their own units
/// @param loss_noises the scale of the loss in units of the noise
/// @param R, noise what was found
inline Portfolio find_stories(RobustRun& run, const MeasurementGraph& graph, double loss_noises,
                              Rotations R, double noise, const TrajectoryStories& trajectory) {
  using namespace detail;
  constexpr int most_rounds = 4, depth = 3, wider = 2 * most_strongest;
  StorySearch search(run, graph, loss_noises, std::move(R), noise, trajectory.odometry);
  const auto as_it_is = [&] {
    search.turn_sides();
    return search.result();
  };

  // 1.
  if (!search.has_time()) return as_it_is();
  const auto agreeing = [&] {
    return agreeing_turns(graph, search.best().rotations, search.best().x, contradiction,
                          search.tolerance());
  };
  const bool one_story = !search.is_coarse() && agreeing().empty();
  if (one_story && search.hardly_any_contradicts()) return as_it_is();
  const Neighbourhoods neighbourhoods(graph, run.keep_going());
  const bool uneven = graph.max_weight() > graph.min_weight();
  std::vector<double> relative;
  if (uneven) relative = relative_weights(graph, run.given());
  const std::vector<double> overlap = neighbourhoods.overlap(run.given());
  const std::vector<double> strength = shared_strongest(graph, neighbourhoods, overlap);
  if (!search.goes_on()) return as_it_is();  // before all was looked at
  const Evidence evidence(graph, strength, relative);
  search.compare_by(evidence);
  if (one_story && !search.voices_contradict() &&
      rejected_and_coherent(search.best().x, overlap).empty()) {
    return as_it_is();
  }
  const auto strongest_by = [&](const std::vector<double>& weights) {
    Strongest by;
    by.overlap = neighbourhoods.overlap(weights);
    by.strength = shared_strongest(graph, neighbourhoods, by.overlap);
    by.ends = strongest(graph, by.strength);
    by.ballots = ballots_of(by.ends);
    return by;
  };
  const std::vector<double> ballots = ballots_of(evidence.voices());
  if (trajectory.grown && !neighbourhoods.are_informative()) {
    search.add("edges that bear one another out", *trajectory.grown);
    if (trajectory.given_up) search.add("odometry, or none", *trajectory.given_up);
    search.add_tree("the tree of the strongest edges", strength, ballots);
    if (uneven && search.goes_on()) {
      const Strongest by = strongest_by(relative);
      search.add_tree("the tree of the edges strongest for their turn", by.strength, by.ballots);
      search.add("l1 of the edges strongest for their turn",
                 run.agreed_by(skeleton(graph, by.ends)), by.ballots);
    }
    if (search.goes_on()) search.choose_by_cost();
    search.turn_sides();
    return search.result(/*rules_out=*/false);
  }

  // 2. and 3.
  search.attempt_tree("the tree of the strongest edges", strength, ballots);
  if (uneven && search.goes_on()) {
    const Strongest by = strongest_by(relative);
    search.attempt_tree("the tree of the edges strongest for their turn", by.strength, by.ballots);
    if (search.doubtful()) {
      search.attempt("l1 of the edges strongest for their turn",
                     run.agreed_by(skeleton(graph, by.ends)), by.ballots);
    }
    if (search.doubtful()) {
      search.attempt_tree("the tree by relative weight and overlap", times(relative, by.overlap),
                          by.ballots);
    }
  }
  if (search.doubtful()) {
    search.attempt("l1 of the strongest edges", run.agreed_by(skeleton(graph, evidence.voices())),
                   ballots);
  }
  const auto rejects_coherent_ones = [&] {
    return search.goes_on() && !rejected_and_coherent(search.best().x, overlap).empty();
  };
  if (uneven && rejects_coherent_ones()) {
    const Strongest by = strongest_by(std::vector<double>(overlap.size(), 1.0));
    search.attempt_tree("the tree of the edges strongest whatever they weigh", by.strength,
                        by.ballots);
    if (rejects_coherent_ones()) {
      search.attempt("l1 of the edges strongest whatever they weigh",
                     run.agreed_by(skeleton(graph, by.ends)), by.ballots);
    }
  }
  if (search.doubtful()) {
    std::vector<double> deeper = overlap;
    for (int k = 0; k < depth; ++k) deeper = shared_strongest(graph, neighbourhoods, deeper, wider);
    search.attempt_tree("the tree of the strongest of the strongest", deeper, ballots);
  }
  if (uneven && search.doubtful()) {
    search.attempt_tree("the tree by weight and overlap", times(run.given(), overlap), ballots);
  }
  if (uneven && search.doubtful()) {
    search.attempt_tree("the tree by weight", run.given(),
                        ballots_of(strongest(graph, run.given())));
  }
  // Strengths are 1 at most.
  const auto with_first = [](std::vector<double> key, const std::vector<Index>& edges) {
    for (const Index k : edges) key[k] += 1.0;
    return key;
  };
  bool better = true;
  for (int k = 0; better && k < most_rounds && search.doubtful() && search.voices_contradict();
       ++k) {
    std::vector<Index> rejected;
    for (Index e = 0; e < graph.num_edges(); ++e) {
      const bool contradicts = search.best().x[e] > contradiction;
      if (contradicts && evidence.voices()[e] > 0.0) rejected.push_back(e);
    }
    better = search.attempt_tree("the tree of strong edges that were rejected",
                                 with_first(strength, rejected), ballots);
  }

  // 4.
  const std::vector<double> rejected = rejected_and_coherent(search.best().x, overlap);
  if (!rejected.empty() && search.goes_on()) {
    search.attempt_tree("the tree of the rejected edges", rejected, ballots);
  }
  const std::vector<Index> turn = agreeing();
  if (!turn.empty() && search.goes_on()) {
    search.add_tree("the tree of rejected edges that agree", with_first(strength, turn), ballots);
  }
  search.turn_sides();
  if (search.goes_on()) search.add_other_places();

  // 5.
  const bool doubts_itself = weigh_hardly_less(search.best().x, overlap, relative);
  return search.result(/*rules_out=*/!doubts_itself);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

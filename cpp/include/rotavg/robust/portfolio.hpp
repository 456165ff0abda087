#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
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

inline std::vector<double> times(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t k = 0; k < a.size(); ++k) a[k] *= b[k];
  return a;
}

}  // namespace detail

/// Compares what least squares and l1 have found with where other starts lead.
///
/// 1. Where hardly any edge contradicts, none of those that do agree with one another on a turn
///    (agreeing_turns), and the noise is small enough to tell, there is but one story, and nothing
///    more is done. Nor is it where hardly any of the strongest edges contradicts (Evidence).
/// 2. The maximum spanning tree by strength (shared_strongest) is polished, and, where weights
///    differ, that by the strength which relative weights give. If they tell the same story, that
///    is it.
/// 3. While that is doubtful: l1 on the strongest edges alone, of either kind, the trees by
///    relative weight and overlap, by what the strongest of the strongest share, by weight and
///    overlap, by weight alone, and by what the strongest edges say that the best answer rejects.
/// 4. What the rejected edges would say, if many of them are coherent or some agree on a turn. Of
///    parts that a single edge holds the best answer takes the likely place (take_likely_turns),
///    also where 1. ends the search; other places are further answers (other_places).
/// 5. What the evidence does not rule out is an alternative; where many rejected edges are as
///    coherent as those that were kept, and weigh hardly less, any other answer is.
///
/// @param run that judges residuals in their own units
/// @param loss_noises the scale of the loss in units of the noise
/// @param R, noise what was found
/// @param was_grown whether edges that bear one another out were a start (grown_from_tree)
inline Portfolio find_stories(RobustRun& run, const MeasurementGraph& graph, double loss_noises,
                              Rotations R, double noise, bool was_grown) {
  using namespace detail;
  constexpr int most_rounds = 4, depth = 3, wider = 2 * most_strongest;
  StorySearch search(run, graph, loss_noises, std::move(R), noise);
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

  if (was_grown && !neighbourhoods.tell()) return as_it_is();

  // 2. and 3.
  const std::vector<double> ballots = ballots_of(evidence.voices());
  search.attempt_tree("the tree of the strongest edges", strength, ballots);
  if (uneven && search.goes_on()) {
    const std::vector<double> alike = neighbourhoods.overlap(relative);
    const std::vector<double> key = shared_strongest(graph, neighbourhoods, alike);
    const std::vector<double> ends = strongest(graph, key), others = ballots_of(ends);
    search.attempt_tree("the tree of the edges strongest for their turn", key, others);
    if (search.doubtful()) {
      search.attempt("l1 of the edges strongest for their turn",
                     run.agreed_by(skeleton(graph, ends)), others);
    }
    if (search.doubtful()) {
      search.attempt_tree("the tree by relative weight and overlap", times(relative, alike),
                          others);
    }
  }
  if (search.doubtful()) {
    search.attempt("l1 of the strongest edges", run.agreed_by(skeleton(graph, evidence.voices())),
                   ballots);
  }
  const auto many_are_coherent = [&] {
    return search.goes_on() && !rejected_and_coherent(search.best().x, overlap).empty();
  };
  if (uneven && many_are_coherent()) {
    const std::vector<double> evenly =
        neighbourhoods.overlap(std::vector<double>(overlap.size(), 1.0));
    const std::vector<double> key = shared_strongest(graph, neighbourhoods, evenly);
    const std::vector<double> ends = strongest(graph, key), others = ballots_of(ends);
    search.attempt_tree("the tree of the edges strongest whatever they weigh", key, others);
    if (many_are_coherent()) {
      search.attempt("l1 of the edges strongest whatever they weigh",
                     run.agreed_by(skeleton(graph, ends)), others);
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

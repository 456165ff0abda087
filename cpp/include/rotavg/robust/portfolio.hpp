#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/robust/evidence.hpp>
#include <rotavg/robust/likely_turns.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/neighbourhoods.hpp>
#include <rotavg/robust/part_votes.hpp>
#include <rotavg/robust/relative_weights.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/stories.hpp>
#include <rotavg/robust/strongest.hpp>
#include <rotavg/robust/votes.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// An answer that a start has led to.
struct Story {
  std::string start;  ///< in words
  Rotations rotations;
  double noise = 0.0;     ///< radians
  std::vector<double> x;  ///< squared residuals (m,) in units of the noise, the same for all
};

/// What a portfolio of starts has found.
struct Portfolio {
  Story best;
  bool replaced = false;             ///< by another than the given one
  std::vector<Story> alternatives;   ///< that differ, and that the evidence does not rule out
  std::optional<Evidence> evidence;  ///< if any was needed
  Index tried = 1;                   ///< starts
  Index different = 1;               ///< different answers to which they led
  Index turned = 0;                  ///< sides of the best, by take_likely_turns
};

namespace detail {

/// A start along a tree, polished: a few reweightings, at first with so wide a scale that its edges
/// do not stay met exactly, which would pass for little noise; votes of the nodes, in which their
/// strongest edges count, and of the sides of cuts.
inline Story polished(RobustRun& run, const MeasurementGraph& graph,
                      const std::vector<double>& voices, double loss_noises, std::string start,
                      Rotations R) {
  constexpr double most_noise = 0.5, outlier_noises = 3.0, wide_noises = 3.0;
  constexpr double brief_gain = 1e-3, gain = 1e-4;
  constexpr int brief_limit = 8, limit = 20, most_rounds = 3;
  const auto noise_now = [&] { return std::min(most_noise, run.noise_at(R)); };
  double noise = noise_now();
  R = run.reweighted(R, {Loss::cauchy, wide_noises * noise}, brief_gain, brief_limit).rotations;
  noise = noise_now();
  take_votes(graph, voices, run.precision(), {Loss::geman_mcclure, outlier_noises * noise}, R,
             run.keep_going());
  R = run.reweighted(R, {Loss::cauchy, wide_noises * noise}, brief_gain, brief_limit).rotations;
  noise = noise_now();
  R = run.reweighted(R, {Loss::cauchy, loss_noises * noise}, gain, limit).rotations;
  for (int k = 0; k < most_rounds; ++k) {
    noise = noise_now();
    if (take_part_votes(graph, run.precision(), run.squared_residuals_at(R), outlier_noises * noise,
                        R) == 0) {
      break;
    }
    R = run.reweighted(R, {Loss::cauchy, loss_noises * noise}, gain, brief_limit).rotations;
  }
  Story story;
  story.start = std::move(start);
  story.noise = noise_now();
  story.rotations = std::move(R);
  return story;
}

}  // namespace detail

/// Whether an answer with so little noise is more than a tree that meets itself: n - 1 edges can be
/// met exactly by any answer, and a noise that they alone bear out is none. It takes further edges,
/// which close cycles.
///
/// @param x squared residuals (m,) in units of the noise
inline bool closes_cycles(const std::vector<double>& x, Index num_nodes) {
  constexpr double met_up_to = 9.0, further = 0.2, few = 3.0;
  const double tree = num_nodes - 1.0;
  const auto met = std::count_if(x.begin(), x.end(), [](double x_k) { return x_k <= met_up_to; });
  return static_cast<double>(met) >= tree + std::max(few, further * tree);
}

/// Keys (m,) of a tree that takes edges first which an answer rejects, though the neighbourhoods of
/// their ends overlap as if they were right; empty if these are few.
inline std::vector<double> rejected_and_coherent(const std::vector<double>& x,
                                                 const std::vector<double>& overlap) {
  constexpr double contradicted = 16.0, many = 0.02, coherent = 0.2, first = 1e3;
  std::vector<double> key = overlap;
  const auto middle = key.begin() + static_cast<std::ptrdiff_t>(key.size() / 2);
  std::nth_element(key.begin(), middle, key.end());
  const double least = coherent * *middle;
  key = overlap;
  std::size_t found = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (x[k] <= contradicted || overlap[k] < least) continue;
    key[k] *= first;
    ++found;
  }
  if (static_cast<double>(found) < many * static_cast<double>(x.size())) key.clear();
  return key;
}

/// Compares what least squares and l1 have found with where other starts lead.
///
/// 1. Where hardly any edge contradicts, and the noise is small enough to tell, there is but one
///    story, and nothing more is done. Nor is it where hardly any of the strongest edges
///    contradicts (Evidence), and those that do not agree with one another.
/// 2. The maximum spanning tree by strength (shared_strongest) is polished, and, where weights
///    differ, that by the strength which relative weights give. If they tell the same story, that
///    is it.
/// 3. While the evidence is not clear, or too much of it speaks against the best answer, to which
///    no two other starts have led: l1 on the strongest edges alone, of either kind, the trees by
///    relative weight and overlap, by what the strongest of the strongest share, by weight and
///    overlap, and by what the strongest edges say that the best answer rejects.
/// 4. What the rejected edges would say, if many of them agree with one another. Of parts that a
///    single edge holds the best answer takes the likely place (take_likely_turns), also where 1.
///    ends the search; other places are further answers (other_places).
/// 5. All are compared at one scale, the noise of the first, or the smallest if that is coarse. One
///    takes the place of the first where relative weights or voices clearly prefer it, of
///    several the one that they prefer; what they do not rule out is an alternative.
///
/// @param run that judges residuals in their own units
/// @param loss_noises the scale of the loss in units of the noise
inline Portfolio find_stories(RobustRun& run, const MeasurementGraph& graph, double loss_noises,
                              Rotations R, double noise) {
  constexpr double contradicted = 16.0, clear_edges = 0.01, clear_voices = 0.01;
  constexpr double coarse = 0.1;  // noise that may well be that of an answer between two stories
  constexpr double beyond_doubt = 5.0, few_cameras = 0.02, outlier_noises = 3.0;
  constexpr std::size_t most_places = 3;
  constexpr int most_turns = 3, enough_starts = 2, most_rounds = 4, depth = 3,
                wider = 2 * strongest_of_a_camera;
  // Of cameras on a line, each with its eight nearest, ten edges cross a place: with one voice of
  // either end. A fold may show at its seam alone, however many cameras there are.
  constexpr double seam = 20.0;
  const std::size_t m = graph.edges().size();
  const auto go_on = run.keep_going();
  Portfolio portfolio;
  std::vector<Story> stories(1);
  stories[0] = {"least squares and l1", std::move(R), noise, {}};
  double scale = noise;
  const auto in_units = [&](double unit, const Rotations& at) {
    std::vector<double> x = run.squared_residuals_at(at);
    for (std::size_t k = 0; k < m; ++k) x[k] *= precision_of(run.precision(), k) / (unit * unit);
    return x;
  };
  const auto units_of = [&](Story& story) { story.x = in_units(scale, story.rotations); };
  units_of(stories[0]);
  const auto turn_sides = [&](Story& story) {
    for (int k = 0; k < most_turns && go_on(); ++k) {
      const Index turned =
          take_likely_turns(graph, run.precision(), run.squared_residuals_at(story.rotations),
                            outlier_noises * scale, step_tolerance(scale), story.rotations);
      if (turned == 0) break;
      portfolio.turned += turned;
      units_of(story);
    }
  };
  const auto finish = [&] {
    if (portfolio.tried == 1) turn_sides(stories[0]);
    portfolio.best = std::move(stories[0]);
    return std::move(portfolio);
  };

  // 1.
  double against = 0.0;
  for (const double x : stories[0].x) against += x > contradicted;
  const bool fits =
      noise <= coarse && against <= std::min(seam, clear_edges * static_cast<double>(m));
  if (fits || !go_on()) return finish();
  const Neighbourhoods neighbourhoods(graph, go_on);
  const bool uneven = graph.max_weight() > graph.min_weight();
  std::vector<double> relative;
  if (uneven) relative = relative_weights(graph, run.given());
  const std::vector<double> overlap = neighbourhoods.overlap(run.given());
  const std::vector<double> strength = shared_strongest(graph, neighbourhoods, overlap);
  const Evidence evidence(graph, strength, relative);
  portfolio.evidence = evidence;
  double voices = 0.0;
  for (const double v : evidence.voices()) voices += v;
  const auto contradicts = [&](const Story& story) {
    double against_it = 0.0;
    for (std::size_t k = 0; k < m; ++k) {
      if (story.x[k] > contradicted) against_it += evidence.voices()[k];
    }
    return against_it > std::min(seam, clear_voices * voices);
  };
  if (noise <= coarse && !contradicts(stories[0]) &&
      rejected_and_coherent(stories[0].x, overlap).empty()) {
    return finish();
  }

  // 2. and 3.
  const auto ballots_of = [](std::vector<double> ballots) {  // who has no strong edge votes, too
    for (double& ballot : ballots) ballot = 0.5 * ballot + 1e-3;
    return ballots;
  };
  std::vector<double> ballots = ballots_of(evidence.voices());
  const double tolerance = step_tolerance(noise);
  std::size_t best = 0;
  int agreeing = 0;  // other starts that have led to the best
  const auto differ = [&](const Story& a, const Story& b) {
    const auto group = shared_groups(graph, a.rotations, b.rotations, tolerance);
    return std::count(group.begin(), group.end(), 0) <
           static_cast<std::ptrdiff_t>((1.0 - few_cameras) * static_cast<double>(group.size()));
  };
  const auto doubtful = [&] {
    if (!go_on() || run.ended() != Status::not_run) return false;
    if (agreeing < enough_starts && contradicts(stories[best])) return true;
    for (std::size_t k = 0; k < stories.size(); ++k) {
      if (k == best) continue;
      if (evidence.compare(stories[best].x, stories[k].x).lead() <= beyond_doubt) return true;
    }
    return false;
  };
  const auto attempt = [&](const char* start, Rotations from) {
    ++portfolio.tried;
    Story story = detail::polished(run, graph, ballots, loss_noises, start, std::move(from));
    if (noise > coarse && story.noise < scale) {
      if (!closes_cycles(in_units(story.noise, story.rotations), graph.num_nodes())) return;
      scale = story.noise;
      for (Story& other : stories) units_of(other);
    }
    units_of(story);
    const bool agrees = !differ(story, stories[best]);
    agreeing += agrees;
    // Against the first it has to be clear; trees are compared among each other on equal terms.
    const bool better = evidence.compare(story.x, stories[0].x).clear() &&
                        (best == 0 || evidence.compare(story.x, stories[best].x).lead() > 0.0);
    bool same = false;
    for (const Story& other : stories) same = same || !differ(story, other);
    if (same && !better) return;
    if (better) {
      if (!agrees) agreeing = 0;
      best = stories.size();
      portfolio.replaced = true;
    }
    stories.push_back(std::move(story));
  };
  const auto attempt_tree = [&](const char* start, const std::vector<double>& key) {
    attempt(start, along_spanning_tree(graph, key));
  };
  const auto times = [&](std::vector<double> key, const std::vector<double>& shared) {
    for (std::size_t k = 0; k < m; ++k) key[k] *= shared[k];
    return key;
  };
  attempt_tree("the tree of the strongest edges", strength);
  if (uneven && go_on() && run.ended() == Status::not_run) {
    const std::vector<double> alike = neighbourhoods.overlap(relative);
    const std::vector<double> key = shared_strongest(graph, neighbourhoods, alike);
    const std::vector<double> ends = strongest(graph, key);
    std::vector<double> others = ballots_of(ends);
    std::swap(ballots, others);
    attempt_tree("the tree of the edges strongest for their turn", key);
    if (doubtful()) {
      attempt("l1 of the edges strongest for their turn", run.agreed_by(skeleton(graph, ends)));
    }
    if (doubtful()) {
      attempt_tree("the tree by relative weight and overlap", times(relative, alike));
    }
    std::swap(ballots, others);
  }
  if (doubtful()) {
    attempt("l1 of the strongest edges", run.agreed_by(skeleton(graph, evidence.voices())));
  }
  if (doubtful()) {
    std::vector<double> deeper = overlap;
    for (int k = 0; k < depth; ++k) deeper = shared_strongest(graph, neighbourhoods, deeper, wider);
    attempt_tree("the tree of the strongest of the strongest", deeper);
  }
  if (uneven && doubtful()) {
    attempt_tree("the tree by weight and overlap", times(run.given(), overlap));
  }
  for (int k = 0; k < most_rounds && doubtful() && contradicts(stories[best]); ++k) {
    const std::size_t last = best;
    std::vector<double> key = strength;
    for (std::size_t e = 0; e < m; ++e) {
      if (stories[best].x[e] > contradicted && evidence.voices()[e] > 0.0) key[e] += 1.0;
    }
    attempt_tree("the tree of strong edges that were rejected", key);
    if (best == last) break;
  }

  // 4.
  const std::vector<double> rejected = rejected_and_coherent(stories[best].x, overlap);
  if (!rejected.empty() && go_on() && run.ended() == Status::not_run) {
    attempt_tree("the tree of the rejected edges", rejected);
  }
  turn_sides(stories[best]);

  const std::vector<Rotations> elsewhere =
      other_places(graph, run.precision(), run.squared_residuals_at(stories[best].rotations),
                   outlier_noises * scale, stories[best].rotations, few_cameras * graph.num_nodes(),
                   most_places);
  for (const Rotations& placed : elsewhere) {
    Story story{"another edge that would hold a part", placed, scale, {}};
    units_of(story);
    bool same = false;
    for (const Story& other : stories) same = same || !differ(story, other);
    if (!same) stories.push_back(std::move(story));
  }

  // 5.
  std::swap(stories[0], stories[best]);
  for (std::size_t k = 1; k < stories.size(); ++k) {
    if (!differ(stories[0], stories[k])) continue;
    ++portfolio.different;
    if (evidence.rules_out_other(stories[0].x, stories[k].x)) continue;
    portfolio.alternatives.push_back(std::move(stories[k]));
  }
  return finish();
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/robust/evidence.hpp>
#include <rotavg/robust/likely_turns.hpp>
#include <rotavg/robust/odometry.hpp>
#include <rotavg/robust/part_votes.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/stories.hpp>
#include <rotavg/robust/story.hpp>
#include <rotavg/solve/status.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// What a portfolio of starts has found.
struct Portfolio {
  Story best;
  bool replaced = false;             ///< by another than the given one
  std::vector<Story> alternatives;   ///< that differ, and that the evidence does not rule out
  std::optional<Evidence> evidence;  ///< if any was needed
  Index tried = 1;                   ///< starts
  Index different = 1;               ///< different answers to which they led
  Index turned = 0;                  ///< sides of the best, by take_likely_turns
  const char* judge = "the strongest edges";  ///< what has chosen among them
};

/// The stories that starts have led to so far, and the best of them by the evidence.
///
/// All are compared at one scale, the noise of the first, or the smallest if that is coarse. One
/// takes the place of the first where the evidence clearly prefers it, of several the one that it
/// prefers.
class StorySearch {
 public:
  /// @param run that judges residuals in their own units
  /// @param loss_noises the scale of the loss in units of the noise
  /// @param R, noise the first story
  /// @param odometry (m,) edges that are hardly ever wrong, or empty
  StorySearch(RobustRun& run, const MeasurementGraph& graph, double loss_noises, Rotations R,
              double noise, std::vector<bool> odometry)
      : run_(run),
        graph_(graph),
        odometry_(std::move(odometry)),
        loss_noises_(loss_noises),
        noise_(noise),
        scale_(noise) {
    stories_.push_back({"least squares and l1", std::move(R), noise, {}});
    units_of(stories_[0]);
  }

  StorySearch(const StorySearch&) = delete;
  StorySearch& operator=(const StorySearch&) = delete;

  const Story& best() const { return stories_[best_]; }
  /// A chord that noise does not make.
  double tolerance() const { return step_tolerance(noise_); }
  /// Noise that may well be that of an answer between two stories.
  bool is_coarse() const { return noise_ > 0.1; }
  bool has_time() const { return run_.keep_going()(); }

  /// Whether hardly any edge contradicts the best. Of cameras on a line, each with its eight
  /// nearest, ten edges cross a place: with one voice of either end. A fold may show at its seam
  /// alone, however many cameras there are.
  bool hardly_any_contradicts() const {
    return weight_against(std::vector<double>(best().x.size(), 1.0)) <=
           few_of(static_cast<double>(best().x.size()));
  }

  /// What the stories are compared by from now on.
  void compare_by(Evidence evidence) {
    evidence_ = std::move(evidence);
    all_voices_ = 0.0;
    for (const double v : evidence_->voices()) all_voices_ += v;
  }
  /// Whether more than hardly any voices contradict the best.
  bool voices_contradict() const {
    return weight_against(evidence_->voices()) > few_of(all_voices_);
  }

  /// While the evidence is not clear, or too much of it speaks against the best answer, to which no
  /// two other starts have led.
  bool doubtful() const {
    constexpr double beyond_doubt = 5.0;
    constexpr int enough_starts = 2;
    if (!goes_on()) return false;
    if (agreeing_ < enough_starts && voices_contradict()) return true;
    for (std::size_t k = 0; k < stories_.size(); ++k) {
      if (k == best_) continue;
      if (evidence_->compare(best().x, stories_[k].x).lead() <= beyond_doubt) return true;
    }
    return false;
  }
  bool goes_on() const { return has_time() && run_.ended() == Status::not_run; }

  /// Polishes a start, and tells whether it has become the best. After compare_by().
  /// @param ballots (m,) voices of the edges where nodes vote
  bool attempt(const char* start, Rotations from, const std::vector<double>& ballots) {
    return attempt(start, std::move(from), ballots, Start::met_by_many, Role::any);
  }
  /// The same along the spanning tree with the largest keys (m,).
  bool attempt_tree(const char* start, const std::vector<double>& key,
                    const std::vector<double>& ballots) {
    return attempt_tree(start, key, ballots, Role::any);
  }
  /// The same, but it can only be one more answer: no evidence speaks for its edges but that of
  /// themselves.
  void add_tree(const char* start, const std::vector<double>& key,
                const std::vector<double>& ballots) {
    attempt_tree(start, key, ballots, Role::alternative);
  }

  /// The answer with the least objective at one scale is the best, where there is no evidence to
  /// choose by; or, where odometry is known, that for which least must have gone wrong (mishaps).
  /// Others whose cost is half as much again are no answers.
  void choose_by_cost() {
    constexpr double gain = 1e-4, far = 1.5;
    constexpr int limit = 20;
    const RobustLoss loss{Loss::cauchy, loss_noises_ * scale_};
    std::vector<double> cost;
    for (Story& story : stories_) {
      IterationResult settled = run_.reweighted(story.rotations, loss, gain, limit);
      if (!goes_on()) return;
      story.rotations = std::move(settled.rotations);
      cost.push_back(odometry_.empty() ? settled.objective
                                       : mishaps(run_, graph_, story.rotations, odometry_, scale_));
      story.noise = scale_;
      units_of(story);
    }
    judge_ = odometry_.empty() ? "the least objective" : "the fewest mishaps";
    const auto least = std::min_element(cost.begin(), cost.end());
    std::vector<Story> kept;
    for (std::size_t k = 0; k < stories_.size(); ++k) {
      const bool is_best = cost[k] == *least;
      if (is_best) best_ = kept.size();
      if (is_best) replaced_ = k != 0;
      if (cost[k] <= far * *least) kept.push_back(std::move(stories_[k]));
    }
    stories_ = std::move(kept);
  }

  /// Of parts that a single edge holds the best answer takes the likely place. Not where some edges
  /// are odometry: its steps turn by little, and closures by anything, right or wrong.
  void turn_sides() {
    constexpr int most_turns = 3;
    if (!odometry_.empty()) return;
    Story& story = stories_[best_];
    for (int k = 0; k < most_turns && has_time(); ++k) {
      const Index turned =
          take_likely_turns(graph_, run_.precision(), run_.squared_residuals_at(story.rotations),
                            outlier_noises * scale_, step_tolerance(scale_), story.rotations);
      if (turned == 0) break;
      turned_ += turned;
      units_of(story);
    }
  }
  /// Their other places are further answers.
  void add_other_places() {
    constexpr std::size_t most_places = 3;
    const std::vector<Rotations> elsewhere = other_places(
        graph_, run_.precision(), run_.squared_residuals_at(best().rotations),
        outlier_noises * scale_, best().rotations, few_cameras * graph_.num_nodes(), most_places);
    for (const Rotations& placed : elsewhere) add("another edge that would hold a part", placed);
  }
  /// Another start that can only be one more answer.
  void add(const char* start, Rotations from, const std::vector<double>& ballots) {
    attempt(start, std::move(from), ballots, Start::met_by_many, Role::alternative);
  }
  /// One more answer, as it is.
  void add(const char* start, Rotations R) {
    Story story{start, std::move(R), scale_, {}};
    units_of(story);
    if (!is_known(story)) stories_.push_back(std::move(story));
  }

  /// What was found; this object is used up.
  /// @param rules_out whether the evidence may rule out other answers
  Portfolio result(bool rules_out = true) {
    Portfolio found;
    std::swap(stories_[0], stories_[best_]);
    for (std::size_t k = 1; k < stories_.size(); ++k) {
      if (!differ(stories_[0], stories_[k])) continue;
      ++found.different;
      if (rules_out && evidence_->rules_out_other(stories_[0].x, stories_[k].x)) continue;
      found.alternatives.push_back(std::move(stories_[k]));
    }
    found.best = std::move(stories_[0]);
    found.replaced = replaced_;
    found.evidence = std::move(evidence_);
    found.tried = tried_;
    found.turned = turned_;
    found.judge = judge_;
    return found;
  }

 private:
  static constexpr double few_cameras = 0.02;

  enum class Start { met_by_many, tree };  ///< edges: those of a tree are met exactly
  enum class Role { any, alternative };    ///< what an answer can be: the best, too, or not

  bool attempt(const char* start, Rotations from, const std::vector<double>& ballots, Start kind,
               Role role) {
    ++tried_;
    const auto comes_to_best = [&](const Rotations& at) {
      return !is_coarse() && !differ(at, best().rotations);
    };
    std::optional<Story> found;
    if (!comes_to_best(from)) {
      const double noise = noise_to_begin_with(from, kind);
      found = polished(run_, graph_, ballots, loss_noises_, noise, start, std::move(from),
                       comes_to_best);
    }
    if (!found) {
      ++agreeing_;
      return false;
    }
    if (!goes_on()) return false;  // it is not polished
    Story& story = *found;
    if (is_coarse() && story.noise < scale_) {
      if (!closes_cycles(in_units(story.noise, story.rotations), graph_.num_nodes())) return false;
      scale_ = story.noise;
      for (Story& other : stories_) units_of(other);
    }
    units_of(story);
    const bool agrees = !differ(story, best());
    agreeing_ += agrees;
    // Against the first it has to be clear; others are compared among each other on equal terms.
    const bool better = role == Role::any && closes_cycles(story.x, graph_.num_nodes()) &&
                        !bends_more(story, stories_[0]) && compare(story, stories_[0]).clear() &&
                        (best_ == 0 || compare(story, best()).lead() > 0.0);
    if (!better && is_known(story)) return false;
    if (better) {
      if (!agrees) agreeing_ = 0;
      best_ = stories_.size();
      replaced_ = true;
    }
    stories_.push_back(std::move(story));
    return better;
  }
  bool attempt_tree(const char* start, const std::vector<double>& key,
                    const std::vector<double>& ballots, Role role) {
    return attempt(start, along_spanning_tree(graph_, key, run_.keep_going()), ballots, Start::tree,
                   role);
  }
  double noise_to_begin_with(const Rotations& from, Start kind) {
    constexpr double noises = 3.0;
    double noise = run_.noise_at(from);
    // Where edges are of very different precision, paths leave over more than noise off the tree.
    if (kind == Start::tree)
      noise = std::max(noise, std::min(run_.noise_off_tree_at(from), noises * noise_));
    return std::min(most_noise, noise);
  }

  std::vector<double> in_units(double unit, const Rotations& at) {
    std::vector<double> x = run_.squared_residuals_at(at);
    for (std::size_t k = 0; k < x.size(); ++k) {
      x[k] *= precision_of(run_.precision(), k) / (unit * unit);
    }
    return x;
  }
  void units_of(Story& story) { story.x = in_units(scale_, story.rotations); }

  bool differ(const Story& a, const Story& b) const { return differ(a.rotations, b.rotations); }
  bool differ(const Rotations& a, const Rotations& b) const {
    const auto group = shared_groups(graph_, a, b, tolerance());
    return std::count(group.begin(), group.end(), 0) <
           static_cast<std::ptrdiff_t>((1.0 - few_cameras) * static_cast<double>(group.size()));
  }
  /// What speaks for one of two answers. Edges at cameras that the two place otherwise in groups of
  /// fewer than three, or of two in a hundred, do not count: where every camera is placed by itself
  /// to meet its few strongest edges, or its heaviest, these are no evidence, as the answer was
  /// made by them. (What is told of an answer counts all edges: rather too much than too little.)
  Comparison compare(const Story& a, const Story& b) const {
    constexpr double least = 3.0;
    const auto group = shared_groups(graph_, a.rotations, b.rotations, tolerance());
    std::vector<double> size(1 + *std::max_element(group.begin(), group.end()), 0.0);
    for (const Index g : group) size[g] += 1.0;
    const double few = std::max(least, few_cameras * graph_.num_nodes());
    std::vector<bool> uncounted(group.size());
    for (std::size_t i = 0; i < group.size(); ++i) {
      uncounted[i] = group[i] != 0 && size[group[i]] < few;
    }
    return evidence_->compare(a.x, b.x, uncounted);
  }
  /// Whether a story contradicts odometry where another does not, in more than a few places: then
  /// no evidence of places that look alike speaks for it.
  bool bends_more(const Story& story, const Story& other) const {
    constexpr double few = 0.01, least = 3.0;
    double steps = 0.0, more = 0.0;
    for (std::size_t k = 0; k < odometry_.size(); ++k) {
      if (!odometry_[k]) continue;
      steps += 1.0;
      more += story.x[k] > contradiction;
      more -= other.x[k] > contradiction;
    }
    return more > std::max(least, few * steps);
  }
  bool is_known(const Story& story) const {
    return std::any_of(stories_.begin(), stories_.end(),
                       [&](const Story& other) { return !differ(story, other); });
  }
  /// The weight (m,) of the edges that contradict the best.
  double weight_against(const std::vector<double>& weight) const {
    double against = 0.0;
    for (std::size_t k = 0; k < weight.size(); ++k) {
      if (best().x[k] > contradiction) against += weight[k];
    }
    return against;
  }
  static double few_of(double all) {
    constexpr double seam = 20.0, clear = 0.01;
    return std::min(seam, clear * all);
  }

  RobustRun& run_;
  const MeasurementGraph& graph_;
  std::vector<bool> odometry_;
  double loss_noises_, noise_, scale_;
  std::vector<Story> stories_;
  std::size_t best_ = 0;
  int agreeing_ = 0;  // other starts that have led to the best
  std::optional<Evidence> evidence_;
  double all_voices_ = 0.0;
  Index tried_ = 1, turned_ = 0;
  bool replaced_ = false;
  const char* judge_ = Portfolio().judge;
};

}  // namespace rotavg

#pragma GCC diagnostic pop

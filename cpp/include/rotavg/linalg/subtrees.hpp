#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The forest of supernodes, cut for several threads: ranges of whole subtrees, none of which
/// depends on another, and what is above them all, where threads share the fronts that are large.
/// Where the cut is decides nothing about what is computed.
class Subtrees {
 public:
  struct Range {
    Index begin, end;  // supernodes
    double work;
  };

  /// @param B the size of the blocks
  Subtrees(const SymbolicCholesky& symbolic, int B, int num_threads) {
    const auto& supernodes = symbolic.supernodes();
    std::vector<double> work;  // of subtrees
    for (const auto& node : supernodes) work.push_back(B * B * B * node.work());
    std::vector<double> own(work);
    for (std::size_t s = 0; s < work.size(); ++s) {
      work_ += own[s];
      if (supernodes[s].parent >= 0) work[supernodes[s].parent] += work[s];
    }
    num_threads = threads_for(num_threads, work_);
    // Many small subtrees have even ends, few large ones leave less above them. A path has two at
    // most.
    double least = std::numeric_limits<double>::infinity();
    for (const double parts : {1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0}) {
      Subtrees other;
      other.cut(supernodes, work, 1.01 * work_ / parts);
      const double time = other.time(own, num_threads);
      if (time < least) {
        least = time;
        ranges_.swap(other.ranges_);
        above_.swap(other.above_);
      }
      if (num_threads == 1) break;  // the whole is one range
    }
    for (std::size_t r = 0; r < ranges_.size(); ++r) by_work_.push_back(static_cast<Index>(r));
    std::stable_sort(by_work_.begin(), by_work_.end(),
                     [this](Index a, Index b) { return ranges_[a].work > ranges_[b].work; });
  }

  const std::vector<Range>& ranges() const { return ranges_; }
  /// The supernodes above, children first.
  const std::vector<Index>& above() const { return above_; }
  /// Multiplications of a factorisation, about.
  double work() const { return work_; }

  /// From the leaves to the roots: of_range(range) for all ranges, on several threads, and then
  /// of_supernode(s) for those above, on this one. Now and then, with nothing to do, idle().
  template <typename OfRange, typename OfSupernode, typename Idle>
  void rise(int num_threads, OfRange&& of_range, OfSupernode&& of_supernode, Idle&& idle) const {
    for_each_range(num_threads, of_range, idle);
    for (const Index s : above_) of_supernode(s);
  }

  /// From the roots to the leaves.
  template <typename OfRange, typename OfSupernode>
  void descend(int num_threads, OfRange&& of_range, OfSupernode&& of_supernode) const {
    for (auto s = above_.rbegin(); s != above_.rend(); ++s) of_supernode(*s);
    for_each_range(num_threads, of_range, [] {});
  }

 private:
  Subtrees() = default;

  /// Ranges of at most so much work.
  void cut(const std::vector<Supernode>& supernodes, const std::vector<double>& work, double most) {
    for (Index s = 0; s < static_cast<Index>(supernodes.size()); ++s) {
      if (work[s] > most) {
        above_.push_back(s);
        continue;
      }
      const Index parent = supernodes[s].parent;
      if (parent >= 0 && work[parent] <= most) continue;  // not a whole subtree yet
      const Index first = supernodes[s].first;
      const bool joins =
          !ranges_.empty() && ranges_.back().end == first && ranges_.back().work + work[s] <= most;
      if (!joins) ranges_.push_back({first, first, 0.0});
      ranges_.back().end = s + 1;
      ranges_.back().work += work[s];
    }
  }

  /// How long the threads take, about.
  double time(const std::vector<double>& own, int num_threads) const {
    double longest = 0.0, all = 0.0, above = 0.0;
    for (const Range& range : ranges_) {
      longest = std::max(longest, range.work);
      all += range.work;
    }
    for (const Index s : above_) above += own[s] / threads_for(num_threads, own[s]);
    constexpr double loss = 1.2;  // of threads that meet at every front
    return std::max(longest, all / num_threads) + loss * above;
  }

  template <typename OfRange, typename Idle>
  void for_each_range(int num_threads, OfRange&& of_range, Idle&& idle) const {
    const auto count = static_cast<Index>(ranges_.size());
    Team::run(
        count, num_threads, [&](Index k) { of_range(ranges_[num_threads > 1 ? by_work_[k] : k]); },
        idle);
  }

  std::vector<Range> ranges_;
  std::vector<Index> by_work_;  // the ranges, the longest first
  std::vector<Index> above_;
  double work_ = 0.0;
};

/// Where a pass from the leaves to the roots keeps its fronts, and what they leave over for their
/// parents: a stack for every range of subtrees and one for what is above them.
struct FrontStacks {
  std::vector<std::size_t> front, left_over;  ///< of every supernode, where it begins
  std::size_t size = 0;

  /// @param size_of `std::size_t size_of(supernode)`: of its left-over, and of its front
  template <typename Size>
  FrontStacks(const SymbolicCholesky& symbolic, const Subtrees& subtrees, Size&& size_of)
      : front(symbolic.supernodes().size()), left_over(front) {
    std::size_t bottom = 0, top = 0;
    const auto push = [&](Index s) {
      // The children's, if they stand in this stack, are on its top.
      std::size_t base = top;
      symbolic.for_each_child(s, [&](Index c) {
        if (left_over[c] >= bottom) base = std::min(base, left_over[c]);
      });
      const std::size_t rest = size_of(symbolic.supernodes()[s]);
      front[s] = top;
      left_over[s] = base;  // which it takes the place of
      size = std::max(size, top + rest);
      top = base + rest;
    };
    for (const auto& range : subtrees.ranges()) {
      for (Index s = range.begin; s < range.end; ++s) push(s);
      bottom = top = size;
    }
    for (const Index s : subtrees.above()) push(s);
  }
};

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/minorant.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/solve/staircase.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg::detail {

/// The staircases of the minorant at R, one for each component that is not proved, climbed step by
/// step together.
class AnisotropicStairs {
 public:
  static constexpr int first_rank = StaircaseOf<Minorant>::first_rank;

  /// @param components, eliminations must outlive this object
  /// @param is_proved is_proved(c) says so of component c
  template <typename IsProved>
  AnisotropicStairs(const AnisotropicGraph& graph, const Components& components,
                    std::vector<Elimination>& eliminations, const Rotations& R, int num_threads,
                    double max_flops, const std::function<bool()>& keep_going,
                    const IsProved& is_proved)
      : components_(components), parts_(components.nodes.size()) {
    const Minorant minorant(graph, to_quaternions(R), num_threads);
    for (Index c = 0; c < components.size(); ++c) {
      if (components.nodes[c].size() < 2 || is_proved(c)) continue;
      parts_[c] = std::make_unique<StaircaseOf<Minorant>>(minorant, components, c, eliminations[c],
                                                          R, max_flops, keep_going);
    }
  }

  Index rank() const { return rank_; }
  int iterations() const { return iterations_; }

  /// At first to a minimum where they stand, then a step up and to a minimum there.
  /// @param limits limits() are those of the next part
  /// @param top what comes of it, rounded, in the components that have moved
  /// @returns whether any has
  template <typename Limits, typename IsProved>
  bool rise(int max_rank, const Limits& limits, const IsProved& is_proved, Rotations& top) {
    bool moved = false;
    for (Index c = 0; c < components_.size(); ++c) {
      StaircaseOf<Minorant>* const part = parts_[c].get();
      if (!part || (has_settled_ && is_proved(c))) continue;
      const int spent = part->iterations();
      if (!has_settled_) {
        part->settle(limits());
      } else if (part->next_rank() > max_rank || !part->climb(limits())) {
        continue;
      }
      moved = true;
      iterations_ += part->iterations() - spent;
      rank_ = std::max(rank_, part->rank());
      const Rotations part_R = part->rounded();
      const std::vector<Index>& nodes = components_.nodes[c];
      for (std::size_t a = 0; a < nodes.size(); ++a) top[nodes[a]] = part_R[a];
    }
    has_settled_ = true;
    return moved;
  }

  /// What the relaxation bounds, in components that are still not proved.
  template <typename IsProved>
  void bound(const IsProved& is_proved, std::vector<LowerBound>& lower_bounds) {
    for (Index c = 0; c < components_.size(); ++c) {
      if (parts_[c] && !is_proved(c)) lower_bounds[c] = parts_[c]->lower_bound();
    }
  }

 private:
  const Components& components_;
  std::vector<std::unique_ptr<StaircaseOf<Minorant>>> parts_;
  bool has_settled_ = false;
  Index rank_ = 3;
  int iterations_ = 0;
};

}  // namespace rotavg::detail

#pragma GCC diagnostic pop

#pragma once

#include <limits>
#include <vector>

#include <rotavg/types.hpp>

namespace rotavg {

/// A connected component of a graph that grows.
struct OnlineComponent {
  Index ground = -1;         ///< the node that is held; -1 where the component is no more
  std::vector<Index> nodes;  ///< as they came
  double objective = 0.0;    ///< of the edges of the core: the others are met
  double drift = 0.0;        ///< what rounding can have made of the sum
  double weight = 0.0;       ///< of all edges in use
  double lightest = std::numeric_limits<double>::infinity();  ///< of them, about; or less
  double counted = 0.0;      ///< their weight as the floor of the relative gap counts it
  double lower_bound = 0.0;  ///< f* is not below it
  double gap = 0.0;
  double to_gain = 0.0;  ///< what one more step would gain, about
  double gained = 0.0;   ///< the same one step earlier; 0 before there was one
  bool has_converged = true;
  bool is_touched = false;
  bool is_counted = true;    ///< whether `lightest` and `counted` are of the edges of now
  Index no_solve_below = 0;  ///< edges: where solve() did not prove it, it is not asked again soon
  Index num_edges = 0;
};

}  // namespace rotavg

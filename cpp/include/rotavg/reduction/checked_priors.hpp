#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/node_rows.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The priors of one graph, with rows for ids, in the order of the rows; rotations to rounding,
/// directions of length 1.
struct CheckedPriors {
  struct Rotation {
    Index node;
    Matrix3 world_from_node;
    double weight;  // without meaning where it is fixed
  };
  struct Gravity {
    Index node;
    Vector3 down;
    double weight;
  };
  struct Rig {
    Index node;
    NodeId frame;
    Matrix3 frame_from_node;
  };
  std::vector<Rotation> fixed, absolute;
  std::vector<Gravity> gravity;
  std::vector<Rig> rigs;
  Vector3 down;
};

namespace detail {

/// Checks one prior after the other, and finds its row.
class PriorCheck {
 public:
  explicit PriorCheck(const MeasurementGraph& graph) : rows_(graph.nodes()) {}

  Index row(PriorKind kind, NodeId node) const {
    const Index row = rows_.find(node);
    if (row < 0) throw InvalidPrior(kind, node, "is of a node that is not in the graph");
    return row;
  }

  static Matrix3 rotation(PriorKind kind, NodeId node, const Matrix3& R) {
    const double error = orthogonality_error(R);
    if (!(error <= max_orthogonality_error && determinant(R) > 0.0)) {
      throw InvalidPrior(kind, node, "is no rotation, expected R^T R = I and det R = 1");
    }
    return error > negligible_orthogonality_error ? nearest_rotation(R) : R;
  }

  static Vector3 direction(PriorKind kind, NodeId node, const Vector3& v) {
    const bool is_zero = v(0) == 0.0 && v(1) == 0.0 && v(2) == 0.0;
    if (is_finite(v) && !is_zero) return unit_direction(v);
    throw InvalidPrior(kind, node,
                       "is [" + six_digits(v(0)) + ", " + six_digits(v(1)) + ", " +
                           six_digits(v(2)) + "], expected a finite direction other than zero");
  }

  static double weight(PriorKind kind, NodeId node, double weight) {
    if (weight >= min_weight && weight <= max_weight) return weight;
    throw InvalidPrior(kind, node,
                       "has the weight " + six_digits(weight) + ", expected one from " +
                           six_digits(min_weight) + " to " + six_digits(max_weight));
  }

 private:
  NodeRows rows_;
};

/// Those of one node keep their order.
template <typename Prior>
void sort_by_node(std::vector<Prior>& priors, Index num_nodes) {
  std::vector<std::size_t> place(static_cast<std::size_t>(num_nodes) + 1, 0);
  for (const Prior& p : priors) ++place[p.node + 1];
  for (Index i = 0; i < num_nodes; ++i) place[i + 1] += place[i];
  std::vector<Prior> sorted(priors);
  for (const Prior& p : priors) sorted[place[p.node]++] = p;
  priors.swap(sorted);
}

}  // namespace detail

/// @throws InvalidPrior for a node that is not in the graph, that is fixed twice or has a fixed
///         rotation and an absolute prior as well, or that is in two frames; for a matrix that is
///         no rotation, a direction that is zero or not finite, or a weight out of bounds
inline CheckedPriors checked_priors(const MeasurementGraph& graph, const Priors& priors) {
  using Check = detail::PriorCheck;
  const Check check(graph);
  CheckedPriors checked;
  std::vector<int> holds(static_cast<std::size_t>(graph.num_nodes()), 0);
  for (const FixedRotation& p : priors.fixed) {
    const Index row = check.row(PriorKind::fixed, p.node);
    if (holds[row]++ > 0) throw InvalidPrior(PriorKind::fixed, p.node, "stands twice");
    checked.fixed.push_back(
        {row, Check::rotation(PriorKind::fixed, p.node, p.world_from_node), 0.0});
  }
  for (const AbsolutePrior& p : priors.absolute) {
    const Index row = check.row(PriorKind::absolute, p.node);
    if (holds[row] > 0) {
      throw InvalidPrior(PriorKind::absolute, p.node, "is of a node whose rotation is fixed");
    }
    checked.absolute.push_back({row,
                                Check::rotation(PriorKind::absolute, p.node, p.world_from_node),
                                Check::weight(PriorKind::absolute, p.node, p.weight)});
  }
  for (const GravityPrior& p : priors.gravity) {
    checked.gravity.push_back({check.row(PriorKind::gravity, p.node),
                               Check::direction(PriorKind::gravity, p.node, p.down),
                               Check::weight(PriorKind::gravity, p.node, p.weight)});
  }
  std::fill(holds.begin(), holds.end(), 0);
  for (const RigCamera& p : priors.rigs) {
    const Index row = check.row(PriorKind::rig, p.node);
    if (holds[row]++ > 0) throw InvalidPrior(PriorKind::rig, p.node, "stands twice");
    checked.rigs.push_back(
        {row, p.frame, Check::rotation(PriorKind::rig, p.node, p.frame_from_node)});
  }
  detail::sort_by_node(checked.fixed, graph.num_nodes());
  detail::sort_by_node(checked.absolute, graph.num_nodes());
  detail::sort_by_node(checked.gravity, graph.num_nodes());
  detail::sort_by_node(checked.rigs, graph.num_nodes());
  checked.down = Check::direction(PriorKind::down, 0, priors.down);
  return checked;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

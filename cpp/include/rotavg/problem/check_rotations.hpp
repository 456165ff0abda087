#pragma once

#include <stdexcept>
#include <string>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A matrix given for a node that is not a rotation: which node (its row) and why.
class InvalidRotation : public std::invalid_argument {
 public:
  InvalidRotation(Index node, const std::string& reason)
      : std::invalid_argument("the matrix of node " + std::to_string(node) + " " + reason),
        node_(node),
        reason_(reason) {}
  Index node() const { return node_; }
  const std::string& reason() const { return reason_; }

 private:
  Index node_;
  std::string reason_;
};

/// @throws std::invalid_argument if there is not one for each node
inline void require_one_rotation_each(const MeasurementGraph& graph, const Rotations& R) {
  if (static_cast<Index>(R.size()) == graph.num_nodes()) return;
  throw std::invalid_argument("found " + std::to_string(R.size()) + " rotations; expected " +
                              std::to_string(graph.num_nodes()) + ", one for each node");
}

/// Checks rotations that a user gave, and snaps them to exact ones: for anything else the
/// objective means nothing.
/// @throws std::invalid_argument if there is not one for each node
/// @throws InvalidRotation if a matrix is further from a rotation than max_orthogonality_error
inline Rotations checked_rotations(const MeasurementGraph& graph, Rotations R) {
  require_one_rotation_each(graph, R);
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    const double error = orthogonality_error(R[i]);
    const double det = determinant(R[i]);
    if (!(error <= max_orthogonality_error && det > 0.0)) {
      throw InvalidRotation(i, "is not a rotation: R^T R differs from the identity by " +
                                   six_digits(error) + " and the determinant is " +
                                   six_digits(det) + "; expected at most " +
                                   six_digits(max_orthogonality_error) + ", and 1");
    }
    if (error > negligible_orthogonality_error) R[i] = nearest_rotation(R[i]);
  }
  return R;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Nodes that ride on variables with constant rotations,
///
///     R_i = Q_v(i) C_i,
///
/// as a fixed node rides on the world, and a camera of a calibrated rig on its frame. An edge
/// R_i R_ij ~ R_j is one between variables, Q_v(i) (C_i R_ij C_j^T) ~ Q_v(j), of the same weight
/// and cost; where v(i) = v(j) its cost is a constant. So all that solves, certifies and measures a
/// graph does so for what rides on its nodes.
struct Riding {
  Index num_variables = 0;
  std::vector<Index> variable;   ///< (n,) v(i)
  Rotations variable_from_node;  ///< (n,) C_i, rotations to rounding

  /// Every node is a variable of its own.
  static Riding alone(Index num_nodes) {
    Riding riding;
    riding.num_variables = num_nodes;
    riding.variable.resize(static_cast<std::size_t>(num_nodes));
    std::iota(riding.variable.begin(), riding.variable.end(), 0);
    riding.variable_from_node.assign(riding.variable.size(), Matrix3::Identity());
    return riding;
  }

  Index num_nodes() const { return static_cast<Index>(variable.size()); }
  /// Whether an edge between nodes i and j is one between two variables.
  bool joins(Index i, Index j) const { return variable[i] != variable[j]; }

  /// R_i = Q_v(i) C_i (n,) from those of the variables.
  Rotations nodes_from(const Rotations& Q) const {
    Rotations R;
    R.reserve(variable.size());
    for (Index i = 0; i < num_nodes(); ++i) {
      R.push_back(product(Q[variable[i]], variable_from_node[i]));
    }
    return R;
  }

  /// The rotations Q_v nearest to what their nodes say, R_i C_i^T, in the chordal mean; I where no
  /// node rides.
  Rotations variables_from(const Rotations& R) const {
    std::vector<Index> riders(static_cast<std::size_t>(num_variables), 0);
    Rotations Q(riders.size(), Matrix3::Zero());
    for (Index i = 0; i < num_nodes(); ++i) {
      add(Q[variable[i]], product_transposed(R[i], variable_from_node[i]));
      ++riders[variable[i]];
    }
    for (Index v = 0; v < num_variables; ++v) {
      if (riders[v] == 0) Q[v].setIdentity();
      if (riders[v] > 1) Q[v] = nearest_rotation(Q[v]);
    }
    return Q;
  }
};

/// Nodes that ride on variables that ride on variables: R_i = (Q_u(v(i)) D_v(i)) C_i.
/// @param outer of the variables of `inner`
inline Riding riding_on(const Riding& outer, const Riding& inner) {
  Riding riding;
  riding.num_variables = outer.num_variables;
  for (Index i = 0; i < inner.num_nodes(); ++i) {
    const Index v = inner.variable[i];
    riding.variable.push_back(outer.variable[v]);
    riding.variable_from_node.push_back(
        product(outer.variable_from_node[v], inner.variable_from_node[i]));
  }
  return riding;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

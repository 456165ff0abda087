#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

enum class CovarianceStatus {
  not_run,
  computed,
  not_a_minimum,  ///< the Hessian is not positive definite: f does not rise in all directions
  stopped,
};

/// A way in which f is flat: some nodes of a component, its root not among them, may turn together
/// about an axis in the global frame. (Gravity leaves the heading open.) The turn of one of them
/// about it is then held as well.
struct FreeTurn {
  Index held;    ///< that node
  Vector3 axis;  ///< of length 1
};

struct CovarianceOptions {
  /// Of the noise of an edge of weight 1, per axis, radians^2.
  double noise_variance = 1.0;
  /// (m,) of refine_anisotropic(), at whose minimum the rotations then are; empty: at one of f. The
  /// noise variance is then what the inverses of these are multiplied by.
  std::vector<Matrix3> information;
  double prior_information = 1.0;  ///< about an axis, of a prior of weight 1; with `information`
  std::vector<FreeTurn> free_turns;
  std::vector<Index> turn_of;  ///< (n,) free turn that a node takes part in, or -1; may be empty
  int num_threads = 1;
  std::function<bool()> keep_going;  ///< false stops
};

struct Covariances {
  CovarianceStatus status = CovarianceStatus::not_run;
  std::vector<Matrix3> pairs;  ///< radians^2, in the order of the pairs asked for
};

/// A pair of nodes: how well the rotation of `node` is known relative to that of `base`.
struct NodePair {
  Index base;
  Index node;
};

/// @throws std::invalid_argument for a row that is not one of a node
inline void check_pairs(const std::vector<NodePair>& pairs, Index num_nodes) {
  for (const NodePair& pair : pairs) {
    for (const Index node : {pair.base, pair.node}) {
      if (node >= 0 && node < num_nodes) continue;
      throw std::invalid_argument("a pair is of row " + std::to_string(node) +
                                  ", and the graph has " + std::to_string(num_nodes) + " nodes");
    }
  }
}

/// How well the rotations of pairs of nodes are known relative to each other, if all edges are
/// right but for small independent noise.
///
/// If the noise of edge k, as a rotation vector, has the covariance (s^2 / w_k) I, with s^2 the
/// noise variance, then -log of the likelihood is to first order f / (4 s^2), and the errors of the
/// rotations, R_i <- exp(w_i) R_i, have the covariance 4 s^2 H^-1 with H the Hessian of f where the
/// first node of every component is held (the asymptotic covariance of maximum likelihood, to first
/// order in the noise). Of a pair it is that of w_node - w_base, a rotation vector in the global
/// frame:
///
///     C = S_bb + S_nn - S_bn - S_nb,     S = 4 s^2 H^-1,
///
/// which no choice of the gauge changes. A pair with the first node of its component has C = S_nn,
/// the marginal covariance. The blocks of H^-1 come from the sparse factor of H by selected
/// inversion; those of pairs where the factor has no entry from solves.
///
/// With information matrices Omega they are s^2 (J^T Omega J)^-1, J the derivatives of the
/// residuals' logarithms: the same to first order in the noise. Where the chords that these weigh
/// are at no minimum there are none.
///
/// @param R where f is stationary
/// @param pairs each within one component
/// @throws InvalidRotation for a matrix that is none, InvalidEdge for an information matrix that is
///         not finite, symmetric and positive semidefinite
/// @throws std::invalid_argument for a pair of two components or of a row that is not one of a
///         node, for other numbers of matrices or turns, and a noise variance that is negative or
///         not finite
/// @throws TooLarge if the factor and the inverse do not fit in memory
ROTAVG_INLINE Covariances covariances(const MeasurementGraph& graph, const Rotations& R,
                                      const std::vector<NodePair>& pairs,
                                      const CovarianceOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/uncertainty/covariance_impl.hpp>
#endif

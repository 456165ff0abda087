#pragma once

#include <algorithm>
#include <cmath>
#include <functional>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/complement_bound.hpp>
#include <rotavg/certify/local_operator.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A kappa with S >= kappa L on the complement, where S >= cut D there. As in
/// certify/connectivity.hpp, S >= L - diag(2 r), so for every alpha in [0, 1]
///
///     S >= alpha (L - diag(2 r)) + (1 - alpha) cut D,
///
/// which is alpha L at least for alpha = cut / (cut + max 2 r / D).
inline double share_of_laplacian(const CertificateMatrix& S, double cut) {
  double taken = 0.0;
  for (Index a = 0; a < S.num_nodes(); ++a) {
    const double degree = S.graph().degree(S.nodes()[a]);
    taken = std::max(taken, 2.0 * (S.reach(a) + S.block_rounding(a)) / degree);
  }
  return cut / (cut + taken);
}

/// The bound that a random start gives, where it speaks for R (certify/complement_bound.hpp).
///
/// @param resolution how small a gap has to be told from zero
inline ComponentBound bound_by_random_start(const CertificateMatrix& S, const LocalOperator<3>& M,
                                            double cut, double resolution,
                                            const std::function<bool()>& keep_going) {
  double nodes = 0.0;
  for (Index a = 0; a < S.num_nodes(); ++a) {
    nodes += S.leftover_node_rounding(a) / S.graph().degree(S.nodes()[a]);
  }
  const double rounding =
      std::sqrt(S.leftover_edge_rounding() / share_of_laplacian(S, cut)) + std::sqrt(nodes / cut);
  const Eigen::MatrixXd K = S.leftover();
  ComponentBound bound = ComplementBound(M, K, cut, keep_going)(rounding, resolution);
  bound.lambda_min = lambda_min_near_null_vectors(S, K, bound.lambda_min, keep_going);
  return bound;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

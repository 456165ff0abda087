#pragma once

#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A part that gravity alone holds: all of it may turn about g, so that S has two more null
/// vectors, N' = P = I - g g^T at its nodes and zero elsewhere, and no node less makes it definite.
///
/// Off the optimum S is even indefinite to first order: N^T S N' = hat(k) P = g (g x k)^T, with k
/// the torque of the part's gravity on the world. But any symmetric change of Lambda's blocks with
/// trace zero leaves what they bound as it is (duality needs tr Lambda alone), and adding B = g
/// mu^T
/// + mu g^T, mu = g x k, at the world and -B at one node v of the part makes N^T S N' vanish.
///
/// Then x = N c + N' d + z with z zero at the world and P z_v = 0, d = P (x_v - x_w), and S plus
/// any multiple of P at v is the same on such z: that can be definite.
struct FreeHeading {
  Index label;  ///< of the part's nodes in GravityPairs::free_heading
  Index row;    ///< v, in the component
  Matrix3 B;
  Matrix3 P;
  Eigen::Matrix<double, 3, 2> across;  ///< an orthonormal basis of what is at right angles to g
};

/// Those of S's component, whose first node is the world, with R = I; none elsewhere.
inline std::vector<FreeHeading> free_headings(const CertificateMatrix& S,
                                              const GravityPairs& gravity) {
  std::vector<FreeHeading> found;
  if (gravity.free_heading.empty()) return found;
  const Vector3& g = gravity.down;
  const Index world = S.nodes().front();
  for (Index a = 1; a < S.num_nodes(); ++a) {
    // The parts are numbered in the order of their first nodes.
    const Index label = gravity.free_heading[S.nodes()[a]];
    if (label < 0) continue;
    bool known = false;
    for (const FreeHeading& heading : found) known = known || heading.label == label;
    if (known) continue;
    Vector3 k(0.0, 0.0, 0.0);
    for (const HalfEdge& h : S.graph().row(world)) {
      if (gravity.free_heading[h.node] != label) continue;
      const Vector4& e = S.residuals()()[h.edge()];
      const double s = (h.is_i() ? 2.0 : -2.0) * e.w();
      for (int r = 0; r < 3; ++r) k(r) -= s * e(r);
    }
    const Vector3 mu = cross(g, k);
    FreeHeading heading;
    heading.label = label;
    heading.row = a;
    heading.B = outer_product(g, mu);
    add(heading.B, outer_product(mu, g));
    heading.P = outer_product({-g(0), -g(1), -g(2)}, g);
    add_to_diagonal(heading.P, 1.0);
    const Vector3 one = any_across(g), other = cross(g, one);
    for (int r = 0; r < 3; ++r) {
      heading.across(r, 0) = one(r);
      heading.across(r, 1) = other(r);
    }
    found.push_back(heading);
  }
  return found;
}

}  // namespace rotavg

#pragma GCC diagnostic pop

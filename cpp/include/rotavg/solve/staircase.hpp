#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/lifted_certificate_matrix.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/certify/shifted_factorization.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/lobpcg.hpp>
#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/linalg/tall.hpp>
#include <rotavg/problem/lifted.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/lifted_newton.hpp>
#include <rotavg/solve/options.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The Riemannian staircase (Boumal 2015; Rosen, Carlone, Bandeira and Leonard 2019) on one
/// component: from rotations that the certificate refutes, up in rank along the direction in which
/// S is negative, to a minimum there, and down again to rotations. At some small rank, where S has
/// no negative direction any more, the minimum is that of the relaxation (6): either its rank is 3,
/// and it is the answer, or it bounds every answer from below.
///
/// @tparam Connection the blocks E_ij at R, as of LiftedProblemOf
template <typename Connection>
class StaircaseOf {
 public:
  /// The first step goes up to here: from random starts on trajectories rank 5 met the global
  /// optimum, rank 4 not always.
  static constexpr Index first_rank = 5;

  /// @param connection at R
  /// @param R world_from_i, one rotation for each node of the graph
  /// @param components, elimination (of the component, without its root) must outlive this object
  /// @param max_flops no larger matrix is factored
  StaircaseOf(Connection connection, const Components& components, Index component,
              Elimination& elimination, const Rotations& R, double max_flops,
              std::function<bool()> keep_going)
      : connection_(std::move(connection)),
        problem_(connection_, components, component),
        max_flops_(max_flops),
        keep_going_(std::move(keep_going)),
        metric_(problem_, elimination, max_flops, keep_going_),
        at_(problem_.evaluate(problem_.unlifted())) {
    R_.reserve(problem_.nodes().size());
    for (const Index i : problem_.nodes()) R_.push_back(R[i]);
  }

  StaircaseOf(const StaircaseOf&) = delete;
  StaircaseOf& operator=(const StaircaseOf&) = delete;

  Index rank() const { return static_cast<Index>(at_.Z.cols()); }
  /// Where the next step goes up to.
  Index next_rank() const { return std::max(rank() + 1, first_rank); }
  int iterations() const { return iterations_; }

  /// On to a minimum at this rank.
  /// @param options as of climb()
  void settle(const IterationOptions& options) {
    LiftedResult result = lifted_newton(problem_, metric_, std::move(at_.Z), bounded(options));
    iterations_ += result.iterations;
    at_ = std::move(result.point);
  }

  /// One step up, and on to a minimum there.
  /// @param options of the iteration; its tolerance is that of LiftedPoint::relative_gradient
  /// @returns false where S has no negative direction, or the work was stopped
  bool climb(const IterationOptions& options) {
    const auto direction = negative_direction();
    if (!direction) return false;
    LiftedResult result =
        lifted_newton(problem_, metric_, lift(*direction, next_rank()), bounded(options));
    iterations_ += result.iterations;
    at_ = std::move(result.point);
    return true;
  }

  /// The rotations nearest to the lifted blocks, in their three principal dimensions, of the nodes
  /// of the component.
  Rotations rounded() const {
    const SmallEigen principal = small_eigen(inner_products(at_.Z, at_.Z));
    Eigen::MatrixXd X = combinations(at_.Z, principal.vectors.rightCols<3>());
    double orientation = 0.0;  // the three dimensions may come as a reflection
    for (Index a = 0; a < problem_.num_nodes(); ++a) {
      orientation += determinant(transposed_block(X, a));
    }
    if (orientation < 0.0) X.col(0) *= -1.0;
    Rotations R = R_;
    for (Index a = 0; a < problem_.num_nodes(); ++a) {
      R[a] = product(nearest_rotation(transposed_block(X, a)), R_[a]);  // R_i = Y_i = Z_i^T R_i
    }
    return R;
  }

  /// What the lifted point proves, or estimates: no rotations have a lower objective.
  LowerBound lower_bound() {
    solved_ = false;
    const auto S = certificate_matrix();
    const ComponentBound bound =
        bound_certificate_matrix(S, max_flops_, keep_going_, connection_.num_threads());
    const double value = at_.objective - bound.gap -
                         objective_rounding(connection_weight(connection_), at_.objective);
    if (!(value > 0.0)) return {};
    solved_ = value >= (1.0 - 1e-6) * at_.objective;
    const bool proved = bound.method == CertificateMethod::factorization;
    return {value, proved ? CertificateMethod::relaxation : bound.method, solved_};
  }

  /// One line for people.
  /// @param certified whether the way down has met certified rotations
  std::string report(bool certified) const {
    std::ostringstream text;
    text << "the staircase climbed to rank " << rank() << " in " << iterations_ << " iterations";
    if (certified) {
      text << " and met the optimum on its way down";
    } else if (solved_) {
      text << ": the relaxation does not look tight, its optimum was met at rank "
           << null_vectors().cols();
    } else {
      text << " and was not at its end";
    }
    return text.str();
  }

 private:
  /// Newton's method that has not converged after a thousand steps, where weights lie far apart,
  /// does not after twenty thousand.
  static IterationOptions bounded(IterationOptions options) {
    options.max_iterations = std::min(options.max_iterations, 1000);
    return options;
  }

  LiftedCertificateMatrix<Connection> certificate_matrix() const {
    return {connection_, problem_.components(), problem_.component(), at_.Lambda, null_vectors()};
  }

  /// An orthonormal basis of the columns of Z: at a stationary point S Z = 0.
  Eigen::MatrixXd null_vectors() const {
    constexpr double negligible = 1e-8;
    const SmallEigen gram = small_eigen(inner_products(at_.Z, at_.Z));
    const Eigen::Index p = gram.values.size();
    Eigen::Index rank = 0;
    while (rank < p && gram.values(p - 1 - rank) > negligible * gram.values(p - 1)) ++rank;
    Eigen::MatrixXd basis = combinations(at_.Z, gram.vectors.rightCols(rank));
    for (Eigen::Index k = 0; k < rank; ++k) basis.col(k).normalize();
    return basis;
  }

  /// A vector v with v^T S v < 0, if there is one.
  std::optional<Eigen::VectorXd> negative_direction() {
    const auto S = certificate_matrix();
    const Eigen::Index free = S.size() - S.null_vectors().cols();
    if (free < 1) return std::nullopt;
    LobpcgOptions options;
    options.tolerance = 1e-12 * S.max_degree();
    options.relative_tolerance = 0.1;
    options.min_iterations = 5;
    options.max_iterations = 200;
    options.keep_going = keep_going_;
    Eigenpair pair = smallest_eigenpair([&](const Eigen::MatrixXd& X) { return S.apply(X); },
                                        [&](const Eigen::MatrixXd& X) { return metric_.apply(X); },
                                        random_start(S.size(), std::min<Eigen::Index>(3, free)),
                                        S.null_vectors(), options);
    if (!(pair.value < -1e-11 * S.max_degree())) return std::nullopt;
    return std::move(pair.vector);
  }

  /// Z in `rank` dimensions, moved along the direction in one of the new ones, where the objective
  /// is lower. The others get a little noise: a dimension that is zero everywhere stays so.
  LiftedBlocks lift(const Eigen::VectorXd& direction, Index rank) const {
    constexpr double noise = 0.01;
    const Index old = this->rank();
    LiftedBlocks Z = LiftedBlocks::Zero(at_.Z.rows(), rank), V = Z;
    Z.leftCols(old) = at_.Z;
    V.rightCols(rank - old) = noise * direction.cwiseAbs().maxCoeff() *
                              random_start(Z.rows(), static_cast<Eigen::Index>(rank - old));
    V.col(old) = direction;
    double t = 1.0 / direction.cwiseAbs().maxCoeff();
    for (int k = 0; k < 20; ++k, t *= 0.5) {
      LiftedBlocks lifted = problem_.retract(Z, t * V);
      if (problem_.objective(lifted) < at_.objective) return lifted;
    }
    return problem_.retract(Z, t * V);
  }

  Connection connection_;
  LiftedProblemOf<Connection> problem_;
  double max_flops_;
  std::function<bool()> keep_going_;
  ConnectionMetric<LiftedProblemOf<Connection>> metric_;
  LiftedPoint at_;
  Rotations R_;  ///< of the nodes of the component
  int iterations_ = 0;
  bool solved_ = false;  ///< the lifted point is the optimum of the relaxation, to a relative 1e-6
};

/// That of measurements with one weight each.
class Staircase : public StaircaseOf<ResidualQuaternions> {
 public:
  Staircase(const MeasurementGraph& graph, const Components& components, Index component,
            Elimination& elimination, const Rotations& R, int num_threads, double max_flops,
            std::function<bool()> keep_going)
      : StaircaseOf(ResidualQuaternions(graph, to_quaternions(R), num_threads), components,
                    component, elimination, R, max_flops, std::move(keep_going)) {}
};

}  // namespace rotavg

#pragma GCC diagnostic pop

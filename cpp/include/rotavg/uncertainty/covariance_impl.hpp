#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/hessian.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/linalg/selected_inverse.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_precisions.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/logarithms.hpp>
#include <rotavg/types.hpp>
#include <rotavg/uncertainty/covariance.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// The problem of information matrices: what its logarithms make of them is what covariances are
/// made of, and the Hessian of its chords tells whether R is a minimum, which that does not.
struct AnisotropicProblem {
  GravityPairs no_gravity;
  LogLinearization linearization;
  AnisotropicGraph graph;
  AnisotropicResiduals residuals;

  AnisotropicProblem(const MeasurementGraph& measurements, const std::vector<Matrix3>& information,
                     const Rotations& R, int num_threads)
      : linearization(LogObjective(measurements, information, no_gravity), R),
        graph(measurements, never_zero(information)),
        residuals(graph, to_quaternions(R), num_threads) {}
  AnisotropicProblem(const AnisotropicProblem&) = delete;

 private:
  /// An AnisotropicGraph takes no zero; this little changes nothing.
  static std::vector<Matrix3> never_zero(std::vector<Matrix3> information) {
    double largest = 0.0;
    for (const Matrix3& H : information) largest = std::max(largest, H.trace());
    const double little = largest > 0.0 ? unit_roundoff * largest : 1.0;
    for (Matrix3& H : information) {
      if (!(H.trace() > 0.0)) add_to_diagonal(H, little);
    }
    return information;
  }
};

/// The covariances of some pairs of one component.
class ComponentCovariances {
 public:
  /// @param residuals, components, anisotropic, options must outlive this object; `anisotropic` may
  ///        be null
  ComponentCovariances(const ResidualQuaternions& residuals, const Components& components,
                       Index component, const AnisotropicProblem* anisotropic,
                       const CovarianceOptions& options)
      : residuals_(residuals),
        components_(components),
        elimination_(residuals.graph(), components, component, /*skipped=*/1,
                     resolve_num_threads(options.num_threads)),
        anisotropic_(anisotropic),
        options_(options),
        scale_((anisotropic ? 2.0 : 4.0) * options.noise_variance) {
    double bytes = 0.0;  // of the factor and of the inverse
    for (const auto& s : elimination_.symbolic()->supernodes()) {
      bytes += 2.0 * 9.0 * sizeof(double) * static_cast<double>(s.rows()) * s.columns();
    }
    if (bytes > physical_memory()) {
      std::ostringstream message;
      message.precision(3);
      message << "the covariances need " << bytes * 1e-9 << " GB, and this process may have "
              << physical_memory() * 1e-9 << " GB";
      throw TooLarge(message.str());
    }
  }

  /// @param chosen places in `pairs` of those of this component
  CovarianceStatus operator()(const std::vector<NodePair>& pairs, std::vector<Index> chosen,
                              const std::function<bool()>& keep_going,
                              std::vector<Matrix3>& result) {
    BlockCholesky<3> cholesky(elimination_.symbolic(), elimination_.num_threads());
    if (anisotropic_) {
      const auto status =
          factorize(hessian_blocks(anisotropic_->residuals, elimination_), keep_going, cholesky);
      if (status != CovarianceStatus::computed) return status;
    }
    const auto status = factorize(anisotropic_ ? anisotropic_->linearization.hessian(elimination_)
                                               : hessian_blocks(residuals_, elimination_),
                                  keep_going, cholesky);
    if (status != CovarianceStatus::computed) return status;
    const SelectedInverse<3> inverse(cholesky, keep_going);
    if (inverse.stopped()) return CovarianceStatus::stopped;

    // Pairs with the same base one after another: one solve serves them all.
    std::stable_sort(chosen.begin(), chosen.end(),
                     [&](Index a, Index b) { return pairs[a].base < pairs[b].base; });
    Index solved = -1;  // the base that `columns` belong to
    Eigen::MatrixXd columns;
    const auto marginal = [&](Index a) -> Matrix3 {
      return a < 0 ? Matrix3::Zero() : Matrix3(inverse(a, a));
    };
    for (const Index k : chosen) {
      if (pairs[k].base == pairs[k].node) continue;  // zero
      const Index a = row_of(pairs[k].base), b = row_of(pairs[k].node);
      Matrix3 cross = Matrix3::Zero();  // in the row of b and the column of a
      if (a >= 0 && b >= 0 && inverse.has(a, b)) {
        cross = inverse(b, a);
      } else if (a >= 0 && b >= 0) {
        if (std::exchange(solved, a) != a) {
          if (keep_going && !keep_going()) return CovarianceStatus::stopped;
          columns.setZero(cholesky.size(), 3);
          columns.middleRows<3>(3 * a).setIdentity();
          cholesky.solve_in_place(columns);
        }
        cross = columns.middleRows<3>(3 * b);
      }
      Matrix3 sum = marginal(a);
      sum += marginal(b);
      sum -= cross;
      sum -= transposed(cross);
      Matrix3 covariance = symmetric_part(sum);
      covariance -= share_of_turns(pairs[k]);
      covariance *= scale_;
      result[k] = without_held_turn(pairs[k], covariance);
    }
    return CovarianceStatus::computed;
  }

 private:
  CovarianceStatus factorize(BlockCholesky<3>::Blocks H, const std::function<bool()>& keep_going,
                             BlockCholesky<3>& cholesky) {
    hold_turns(H);
    switch (cholesky.factorize(H, 0.0, keep_going)) {
      case CholeskyOutcome::not_positive_definite:
        return CovarianceStatus::not_a_minimum;
      case CholeskyOutcome::stopped:
        return CovarianceStatus::stopped;
      case CholeskyOutcome::positive_definite:
        break;
    }
    return CovarianceStatus::computed;
  }

  /// Row of a node in H; -1 for the root, which has none.
  Index row_of(Index node) const {
    return components_.row_in_component[node] - elimination_.skipped();
  }

  /// With t a free turn, H t = 0. H + k a a^T, with a the axis at the node that is held, has the
  /// inverse G + t t^T / k, G that of H where this node does not turn about the axis.
  void hold_turns(BlockCholesky<3>::Blocks& H) {
    for (const FreeTurn& turn : options_.free_turns) {
      if (components_.label[turn.held] != elimination_.component()) continue;
      H[elimination_.pattern().start[row_of(turn.held)]] +=
          outer_product(stiffness(turn) * turn.axis, turn.axis);
    }
  }
  double stiffness(const FreeTurn& turn) const { return residuals_.graph().degree(turn.held); }

  /// C, exactly zero about the axis where the root sees a node whose turn is held.
  Matrix3 without_held_turn(const NodePair& pair, const Matrix3& C) const {
    for (const FreeTurn& turn : options_.free_turns) {
      const bool seen_from_root = row_of(pair.base) < 0 && pair.node == turn.held;
      if (!seen_from_root && !(row_of(pair.node) < 0 && pair.base == turn.held)) continue;
      Matrix3 across = outer_product(-turn.axis, turn.axis);
      add_to_diagonal(across, 1.0);
      return product(product(across, C), across);
    }
    return C;
  }

  /// What the sum of all t t^T / k adds to a pair: nothing where both turn together.
  Matrix3 share_of_turns(const NodePair& pair) const {
    Matrix3 share = Matrix3::Zero();
    if (options_.turn_of.empty()) return share;
    const Index a = options_.turn_of[pair.base], b = options_.turn_of[pair.node];
    if (a == b) return share;
    for (const Index k : {a, b}) {
      if (k < 0) continue;
      const FreeTurn& turn = options_.free_turns[k];
      share += outer_product(turn.axis / stiffness(turn), turn.axis);
    }
    return share;
  }

  const ResidualQuaternions& residuals_;
  const Components& components_;
  Elimination elimination_;
  const AnisotropicProblem* anisotropic_;
  const CovarianceOptions& options_;
  double scale_;
};

inline void check_noise(double variance) {
  if (variance >= 0.0 && std::isfinite(variance)) return;
  throw std::invalid_argument("the noise variance must be a number that is not negative");
}

/// @throws InvalidEdge, std::invalid_argument for what cannot be
inline CovarianceOptions checked(const MeasurementGraph& graph, CovarianceOptions options) {
  check_noise(options.noise_variance);
  if (!options.information.empty()) {
    options.information = checked_precisions(graph.num_edges(), std::move(options.information),
                                             "information matrices");
  }
  const auto turns = static_cast<Index>(options.free_turns.size());
  const auto is_turn = [&](Index turn) { return turn >= -1 && turn < turns; };
  const auto& turn_of = options.turn_of;
  const bool fits = turn_of.empty() || static_cast<Index>(turn_of.size()) == graph.num_nodes();
  if (!fits || !std::all_of(turn_of.begin(), turn_of.end(), is_turn)) {
    throw std::invalid_argument("turn_of must have a free turn or -1 for each node");
  }
  for (const FreeTurn& turn : options.free_turns) {
    if (turn.held >= 0 && turn.held < graph.num_nodes()) continue;
    throw std::invalid_argument("a free turn holds a node that the graph does not have");
  }
  return options;
}

/// covariances() of what was checked; information matrices may be zero, of edges that know nothing.
inline Covariances covariances_of_pairs(const MeasurementGraph& graph, const Rotations& R,
                                        const std::vector<NodePair>& pairs,
                                        const CovarianceOptions& options) {
  const Components components = connected_components(graph);
  std::vector<std::vector<Index>> chosen(components.nodes.size());
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const Index c = components.label[pairs[k].base];
    if (components.label[pairs[k].node] != c) {
      throw std::invalid_argument("the nodes of pair " + std::to_string(k) +
                                  " are not connected: their rotations are not known relative to "
                                  "each other");
    }
    chosen[c].push_back(static_cast<Index>(k));
  }
  const ResidualQuaternions residuals(graph, to_quaternions(R),
                                      resolve_num_threads(options.num_threads, graph.num_edges()));
  std::optional<AnisotropicProblem> anisotropic;
  if (!options.information.empty()) {
    anisotropic.emplace(graph, options.information, R, residuals.num_threads());
  }
  Covariances result;
  result.pairs.assign(pairs.size(), Matrix3::Zero());
  for (Index c = 0; c < components.size(); ++c) {
    if (chosen[c].empty() || components.nodes[c].size() < 2) continue;
    result.status = ComponentCovariances(residuals, components, c,
                                         anisotropic ? &*anisotropic : nullptr, options)(
        pairs, std::move(chosen[c]), options.keep_going, result.pairs);
    if (result.status != CovarianceStatus::computed) return result;
  }
  result.status = CovarianceStatus::computed;
  return result;
}

}  // namespace detail

ROTAVG_INLINE Covariances covariances(const MeasurementGraph& graph, const Rotations& R,
                                      const std::vector<NodePair>& pairs,
                                      const CovarianceOptions& options) {
  check_pairs(pairs, graph.num_nodes());
  return detail::covariances_of_pairs(graph, checked_rotations(graph, R), pairs,
                                      detail::checked(graph, options));
}

}  // namespace rotavg

#pragma GCC diagnostic pop

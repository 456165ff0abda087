#pragma once

#include <algorithm>
#include <limits>
#include <new>
#include <optional>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/connectivity.hpp>
#include <rotavg/certify/factorization.hpp>
#include <rotavg/certify/known_cut.hpp>
#include <rotavg/certify/min_eigenvalue.hpp>
#include <rotavg/certify/proof_costs.hpp>
#include <rotavg/certify/random_start.hpp>
#include <rotavg/certify/random_start_bound.hpp>
#include <rotavg/certify/shifted_factorization.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/so3/quaternion.hpp>

namespace rotavg {

/// What S at some rotations says of one component, by the way that is predicted to cost least:
///
/// - what was proved at rotations nearby (known_cut.hpp), if that is enough;
/// - the factorisation of S, where it is quick, or costs at most a few times what a random start
///   would: it is the surest, and the only one that graphs with long thin parts allow;
/// - the connectivity, which takes 1/27 of that at most, on dense graphs;
/// - a random start before any order is sought, on graphs that seem to fill in;
/// - a random start, whose proof has a stated probability; all threads, and 80 bytes an edge;
/// - where that is inconclusive, the factorisation after all, if it fits into memory and the limit;
/// - and where nothing else is left, a short estimate.
class ComponentBounds {
 public:
  /// @param S, q (world_from_i, where S was taken), elimination (without its root), gravity and
  ///        options must outlive this object
  /// @param resolution how small a gap has to be told from zero
  /// @param noise the objective over the sum of weights
  /// @param known of this component, by an earlier certificate, and renewed by this one; may be
  /// null
  ComponentBounds(const CertificateMatrix& S, const Quaternions& q, Elimination& elimination,
                  double resolution, double noise, const GravityPairs& gravity,
                  const CertificateOptions& options, KnownCut* known)
      : S_(S),
        q_(q),
        elimination_(elimination),
        resolution_(resolution),
        noise_(noise),
        gravity_(gravity),
        options_(options),
        known_(known) {
    for (const Index i : S.nodes()) ends_ += static_cast<double>(S.graph().row(i).size());
  }

  ComponentBound operator()() {
    using Costs = ProofCosts;
    constexpr double dense = 0.1, near_complete = 0.5;  // of all pairs of nodes
    const double n = S_.num_nodes(), connectivity_flops = Connectivity::flops(n);
    const double by_products = cost(Costs::usual_products);
    if (const double cut = known_ ? known_->at(S_, q_) : 0.0; cut > 0.0) {
      const ComponentBound bound = by_cut([&] { return LocalOperator<3>(S_, q_); }, cut);
      if (is_enough(bound)) return bound;
    }
    // Dense graphs before a factorisation of S is even analysed: it fills in.
    const double filled = ends_ / n / n;
    if (filled > dense && 27.0 * connectivity_flops > Costs::no_time) {
      const ComponentBound bound = by_connectivity(filled > near_complete, by_products);
      if (is_enough(bound)) return bound;
    }
    bool may_start = options_.failure_probability > 0.0;  // at random
    ComponentBound start_bound;
    if (may_start && !elimination_.has_order()) {
      std::optional<RandomStart> random_start = start_before_an_order(by_products);
      if (random_start) {
        start_bound = by_random_start(*random_start);
        if (is_end(start_bound)) return start_bound;
        // Else it would come to the same end.
        may_start = random_start->is_limited() && !start_bound.is_definite;
      }
    }
    const double by_factor = elimination_.flops(3, options_.max_factorization_flops);
    if (by_factor > std::max(4.0 * connectivity_flops, Costs::quick)) {
      const ComponentBound bound = by_connectivity(
          /*by_norm=*/false, std::max(Costs::quick, Costs::worth_certainty * by_products));
      if (is_enough(bound)) return bound;
    }
    bool can_factorize = by_factor <= options_.max_factorization_flops && fits();
    if (can_factorize &&
        by_factor <= std::max(Costs::quick, Costs::worth_certainty * by_products)) {
      if (const auto bound = factorized()) return better(*bound, start_bound);
      can_factorize = false;
    }
    if (can_factorize) {
      if (may_start) {
        RandomStart random_start(S_, q_, random_start_options());
        random_start.limit_products(by_factor / cost(1.0));
        if (random_start.may_do()) {
          start_bound = by_random_start(random_start);
          if (is_end(start_bound)) return start_bound;
          may_start = !start_bound.is_definite;  // more products may do
        }
      }
      if (const auto bound = factorized()) return better(*bound, start_bound);
    }
    if (may_start) {
      RandomStart random_start(S_, q_, random_start_options());
      start_bound = by_random_start(random_start);
      if (is_end(start_bound)) return start_bound;
    }
    if (start_bound.method != CertificateMethod::none) return start_bound;
    return bound_by_eigenvalue(S_, options_.keep_going, few_iterations);
  }

 private:
  static constexpr int few_iterations = 100;

  bool stopped() const { return options_.keep_going && !options_.keep_going(); }

  /// Whether nothing else need be tried: a bound that rounding has not spoiled, or a stop.
  bool is_enough(const ComponentBound& bound) const {
    const bool known = bound.method != CertificateMethod::none;
    return stopped() || (known && !(bound.rounding > resolution_));
  }

  /// The same after a random start; or R is refuted.
  bool is_end(const ComponentBound& bound) const {
    return is_enough(bound) || (!bound.is_definite && bound.lambda_min < 0.0);
  }

  static ComponentBound better(const ComponentBound& a, const ComponentBound& b) {
    return b.gap < a.gap ? b : a;
  }

  /// Of products with a vector, in operations of a factorisation. (Reading an edge end with two
  /// columns takes as long as some 150 of those. The number of threads has no say: the answer
  /// would depend on it.)
  double cost(double products) const { return 75.0 * products * ends_; }

  /// A proof by the connectivity: by a norm, where that may do, and by a factorisation of at most
  /// so many operations. CertificateMethod::none where these say nothing.
  ComponentBound by_connectivity(bool by_norm, double max_flops) {
    const double flops = Connectivity::flops(S_.num_nodes());
    const double bytes = sizeof(double) * 3.0 * flops / S_.num_nodes();
    const bool factorizes = !connectivity_failed_ && has_memory_for(bytes) &&
                            flops <= std::min(max_flops, options_.max_factorization_flops);
    if (!by_norm && !factorizes) return {};
    const Connectivity connectivity(S_);
    ComponentBound bound;
    if (by_norm) bound = connectivity.bound_by_norm(options_.keep_going);
    if (is_enough(bound) || !factorizes) return bound;
    connectivity_failed_ = true;  // else nothing comes after
    return connectivity.bound_by_factorization(options_.keep_going);
  }

  /// Where S fills in, an order of elimination alone takes longer than products do: wide levels
  /// make that likely, and on large graphs products tell.
  /// @returns a random start where it is so, and the start may do
  std::optional<RandomStart> start_before_an_order(double by_products) {
    constexpr double large = 2e5;  // ends of edges
    const double bearable_flops =
        std::max(ProofCosts::quick, ProofCosts::worth_certainty * by_products);
    const bool is_wide = elimination_.likely_flops(3) > bearable_flops;
    if (!(ends_ > large || is_wide)) return std::nullopt;
    RandomStart random_start(S_, q_, random_start_options());
    if (ends_ > large && random_start.theta_exceeds(theta_of_separator(bearable_flops))) {
      return random_start;
    }
    if (!is_wide) return std::nullopt;
    // A tree with many branches is wide as well; it takes more.
    random_start.limit_products(ProofCosts::worth_certainty * ProofCosts::usual_products);
    if (!random_start.may_do()) return std::nullopt;
    return random_start;
  }

  bool fits() const {
    constexpr double bytes_a_node = 450.0;  // of conjugate gradients
    double bytes = elimination_.factor_bytes(3);
    const bool may_have_headings = !gravity_.free_heading.empty();
    if (bytes > DefiniteFactorization::large_factor && !may_have_headings) {  // it is not kept
      // (If S is not positive, nothing can be kept then, and other proofs are tried.)
      bytes = std::max(elimination_.definiteness_bytes(3),
                       elimination_.factor_bytes(1) + bytes_a_node * S_.num_nodes());
    }
    return has_memory_for(bytes);
  }

  /// Nothing where the memory is not there after all: others use it, too.
  std::optional<ComponentBound> factorized() {
    try {
      return by_factorization();
    } catch (const std::bad_alloc&) {
      return std::nullopt;
    }
  }

  ComponentBound by_factorization() {
    const auto& keep_going = options_.keep_going;
    {
      DefiniteFactorization proof(S_, elimination_, resolution_, noise_, gravity_);
      auto outcome = proof.factorize(keep_going);
      if (outcome == CholeskyOutcome::positive_definite) return proof.bound(keep_going);
      if (outcome == CholeskyOutcome::stopped) return {};
      BlockCholesky<3>& cholesky = proof.cholesky();
      outcome = cholesky.factorize(S_.blocks(elimination_), 0.0, keep_going);
      if (outcome == CholeskyOutcome::stopped) return {};
      if (outcome == CholeskyOutcome::positive_definite) {
        return bound_by_grounded_factorization(S_, cholesky, keep_going);
      }
    }  // its memory is needed
    return bound_certificate_matrix(S_, options_.max_factorization_flops, keep_going,
                                    elimination_.num_threads());
  }

  /// Where theta is above this, a factorisation takes more than so many operations, about: with a
  /// second eigenvalue lambda of the Laplacian, the largest front has 3/4 n lambda / (Delta + 2
  /// lambda) nodes (the treewidth; Chandran and Subramanian 2003).
  double theta_of_separator(double flops) const {
    const double share = Connectivity::nodes(flops / 27.0) / (0.75 * S_.num_nodes());
    return share < 0.5 ? share / (1.0 - 2.0 * share) : std::numeric_limits<double>::infinity();
  }

  RandomStartOptions random_start_options() const {
    RandomStartOptions start;
    start.failure_probability = options_.failure_probability;
    start.seed = options_.seed;
    start.keep_going = options_.keep_going;
    return start;
  }

  /// CertificateMethod::none where it does not speak for R; then lambda_min may be known.
  ComponentBound by_random_start(RandomStart& random_start) {
    const RandomStartResult result = random_start();
    ComponentBound bound;
    if (result.outcome == RandomStartOutcome::positive) {
      if (known_) known_->remember(S_, q_, result.cut);
      bound = by_cut([&] { return LocalOperator<3>(random_start.M()); }, result.cut);
    } else if (result.outcome == RandomStartOutcome::negative) {
      bound = bound_by_eigenvalue(S_, options_.keep_going, few_iterations, result.x);
    }
    return bound;
  }

  /// CertificateMethod::none where there is no memory for it.
  template <typename Make>
  ComponentBound by_cut(Make&& make_M, double cut) const try {
    const LocalOperator<3> M = make_M();
    ComponentBound bound = bound_by_random_start(S_, M, cut, resolution_, options_.keep_going);
    bound.failure_probability = options_.failure_probability;
    return bound;
  } catch (const std::bad_alloc&) {
    return {};
  }

  const CertificateMatrix& S_;
  const Quaternions& q_;
  Elimination& elimination_;
  double resolution_, noise_;
  const GravityPairs& gravity_;
  const CertificateOptions& options_;
  KnownCut* known_;
  double ends_ = 0.0;  ///< of edges
  bool connectivity_failed_ = false;
};

}  // namespace rotavg

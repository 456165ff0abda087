#pragma once

#include <algorithm>
#include <limits>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/global_operator.hpp>
#include <rotavg/anisotropic/improve_split.hpp>
#include <rotavg/anisotropic/proof.hpp>
#include <rotavg/anisotropic/residuals.hpp>
#include <rotavg/anisotropic/split.hpp>
#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/certify/proof_costs.hpp>
#include <rotavg/certify/random_start.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/quaternion.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// What the gap of every component is held against; the weight of an edge is its scalar one.
inline std::vector<Measure> measure_components(const AnisotropicResiduals& residuals,
                                               const Components& components) {
  std::vector<Measure> measures(components.nodes.size());
  std::vector<double> lightest(measures.size(), std::numeric_limits<double>::infinity());
  const auto& edges = residuals.graph().scalar().edges();
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const Index c = components.label[edges[k].i];
    measures[c].objective += residuals()[k].cost;
    measures[c].total_weight += edges[k].weight;
    measures[c].num_edges += 1.0;
    lightest[c] = std::min(lightest[c], edges[k].weight);
  }
  for (const Edge& e : edges) {
    const Index c = components.label[e.i];
    measures[c].weight += counted_weight(e.weight, lightest[c]);
  }
  for (Measure& measure : measures) {
    const double summing = unit_roundoff * measure.num_edges * measure.objective;
    measure.objective +=
        4.0 * objective_rounding(6.0 * measure.total_weight, measure.objective) + summing;
  }
  return measures;
}

/// Operations of a factorisation that take as long as one column's share of a product of S with
/// two.
inline double cost_of_product(std::size_t num_edges) {
  return 150.0 * static_cast<double>(num_edges);
}

/// Whether a factorisation is not possible, or would cost much more than a random start.
/// @param num_edges of the component
inline bool is_random_start_better(std::size_t num_edges, Elimination& elimination,
                                   bool can_factorize, const CertificateOptions& options) {
  using Costs = ProofCosts;
  if (!(options.failure_probability > 0.0)) return false;
  const double by_products =
      Costs::worth_certainty * Costs::usual_products * cost_of_product(num_edges);
  return !can_factorize || elimination.flops(3, options.max_factorization_flops) >
                               std::max(Costs::quick, by_products);
}

/// CertificateMethod::none where it does not speak for R, or there is no memory for it.
inline ComponentBound bound_component_by_random_start(const AnisotropicCertificateMatrix& S,
                                                      Elimination& elimination, bool can_factorize,
                                                      double resolution,
                                                      const CertificateOptions& options) try {
  RandomStartOptions start;
  start.failure_probability = options.failure_probability;
  start.seed = options.seed;
  start.keep_going = options.keep_going;
  if (can_factorize) {
    const double product = cost_of_product(S.edges().size());
    const double flops = elimination.flops(3, options.max_factorization_flops);
    start.max_products = std::min(start.max_products, flops / product);
  }
  ComponentBound bound;
  RandomStartOf<GlobalOperator> random_start(GlobalOperator<2>(S), start);
  if (can_factorize && !random_start.may_do()) return bound;
  const RandomStartResult result = random_start();
  if (result.outcome == RandomStartOutcome::positive) {
    bound = bound_by_random_start(S, GlobalOperator<3>(random_start.M()), result.cut, resolution,
                                  options.keep_going);
    bound.failure_probability = options.failure_probability;
  } else if (result.outcome == RandomStartOutcome::negative) {
    // Of a vector x that refutes R; else x^T S x = quotient x^T D x is at most this of |x|^2.
    const bool has_x = result.x.size() > 0;
    bound.lambda_min = has_x ? result.x.dot(S.apply(result.x).col(0)) / result.x.squaredNorm()
                             : result.quotient * S.least_scale();
  }
  return bound;
} catch (const std::bad_alloc&) {  // its rows take 160 bytes an edge; a factorisation may do
  return {};
}

/// What S at some rotations says of one component: with the splits in closed form, and if these do
/// not prove, with better ones; at last the gap that the best of them leaves.
/// @param resolution how small a gap has to be told from zero
inline ComponentBound bound_component(EdgeSplits& splits, const Components& components,
                                      Index component, Elimination& elimination, double resolution,
                                      const CertificateOptions& options) {
  constexpr int most_steps = 25, steps_where_definite = 5;
  constexpr double usual_mu = 1e-6, large_mu = 1e-3, kappa = 0.5;
  const double max_flops = options.max_factorization_flops;
  const auto is_possible = [max_flops](Elimination& of) {
    return of.flops(3, max_flops) <= max_flops && has_memory_for(of.factor_bytes(3));
  };
  const auto stopped = [&] { return options.keep_going && !options.keep_going(); };
  const bool can_factorize = is_possible(elimination);
  const AnisotropicGraph& graph = splits.residuals().graph();
  std::size_t ends = 0;
  for (const Index i : components.nodes[component]) ends += graph.row(i).size();
  if (is_random_start_better(ends / 2, elimination, can_factorize, options)) {
    const ComponentBound bound =
        bound_component_by_random_start(AnisotropicCertificateMatrix(splits, components, component),
                                        elimination, can_factorize, resolution, options);
    const bool is_enough = bound.is_definite && !(bound.rounding > resolution);
    if (is_enough || !can_factorize) return bound;
  }
  if (!can_factorize) return {};
  std::optional<SplitImprovement> improvement;
  std::optional<EdgeSplits> best;
  double value = 0.0, lambda_min = 0.0;  // of the best
  ComponentBound definite;               // where S is positive, but rounding or R leave a gap
  for (int k = 0;; ++k) {
    const AnisotropicCertificateMatrix S(splits, components, component);
    ComponentBound bound =
        bound_by_grounded_factorization(S, elimination, usual_mu, options.keep_going);
    for (const double mu : {usual_mu, large_mu}) {
      if (!bound.is_definite || bound.gap <= resolution) break;
      const auto again = bound_by_grounded_factorization(  // of rounding, perhaps
          S.less_firm_edges(kappa), elimination, mu, options.keep_going);
      if (again.gap < bound.gap) bound = again;
    }
    if (bound.gap < definite.gap) definite = bound;
    if (definite.gap <= resolution || stopped()) return definite;
    if (!improvement) improvement.emplace(splits, elimination);
    if (!improvement->measure(S, options.keep_going)) break;
    if (!best || improvement->value() > value) {
      best = splits;
      value = improvement->value();
      lambda_min = improvement->lambda_min();
    }
    const int most = definite.is_definite ? steps_where_definite : most_steps;
    if (k >= most || !improvement->step(S)) break;
  }
  if (definite.is_definite) return definite;
  Elimination whole(splits.residuals().graph().scalar(), components, component, /*skipped=*/0,
                    elimination.num_threads());
  if (!best || stopped() || !is_possible(whole)) return {};
  ComponentBound bound =
      bound_by_shifted_factorization(AnisotropicCertificateMatrix(*best, components, component),
                                     whole, -value, options.keep_going);
  bound.lambda_min = lambda_min;
  return bound;
}

}  // namespace detail

ROTAVG_INLINE Certificate certify(const AnisotropicGraph& graph, const Rotations& R,
                                  const Components& components,
                                  std::vector<Elimination>& eliminations,
                                  const CertificateOptions& options,
                                  const std::vector<LowerBound>& known) {
  check(options);
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());
  const AnisotropicResiduals residuals(graph, to_quaternions(R), num_threads);
  EdgeSplits splits(residuals);
  const auto measures = detail::measure_components(residuals, components);
  std::vector<ComponentCertificate> parts;
  for (Index c = 0; c < components.size(); ++c) {
    if (components.nodes[c].size() < 2) {  // every rotation is optimal
      parts.push_back({Verdict::proved, CertificateMethod::factorization, 0.0, 0.0, 0.0});
      continue;
    }
    const double resolution = measures[c].scale() * options.tolerance;
    ComponentBound bound;
    try {
      bound = detail::bound_component(splits, components, c, eliminations[c], resolution, options);
    } catch (const std::bad_alloc&) {  // others use the memory, too: then nothing is known
    }
    parts.push_back(detail::certify_component(bound, known.empty() ? LowerBound{} : known[c],
                                              measures[c], options.tolerance));
  }
  Certificate certificate = detail::certificate_of(std::move(parts), options.tolerance);
  const bool stopped = options.keep_going && !options.keep_going();
  if (stopped) certificate.shortfall = detail::shortfall_if_stopped(certificate);
  return certificate;
}

ROTAVG_INLINE Certificate certify(const AnisotropicGraph& graph, const Rotations& given,
                                  const CertificateOptions& options) {
  const Components components = connected_components(graph.scalar());
  std::vector<Elimination> eliminations =
      grounded_eliminations(graph.scalar(), components, resolve_num_threads(options.num_threads));
  return certify(graph, checked_rotations(graph.scalar(), given), components, eliminations,
                 options);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

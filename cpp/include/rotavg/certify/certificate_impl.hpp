#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/certificate_matrix.hpp>
#include <rotavg/certify/component_bound.hpp>
#include <rotavg/certify/component_certificate.hpp>
#include <rotavg/certify/known_cut.hpp>
#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/problem/residual_quaternions.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

namespace detail {

/// Adds to objectives what rounding can have taken away.
/// @param additions that every sum of costs took
inline void add_rounding(double additions, Measure& measure) {
  const double summing = unit_roundoff * additions * measure.objective;
  measure.objective += objective_rounding(measure.total_weight, measure.objective) + summing;
}

/// Where every edge counts for what it weighs: from the sums at the nodes, without a further pass.
inline std::vector<Measure> measure_by_nodes(const NodeSums& sums, const Components& components) {
  std::vector<Measure> measures(components.nodes.size());
  for (std::size_t c = 0; c < measures.size(); ++c) {
    Measure& measure = measures[c];
    double most_ends = 0.0;
    for (const Index i : components.nodes[c]) {
      const double ends = sums.graph().row(i).size();
      most_ends = std::max(most_ends, ends);
      measure.total_weight += 0.5 * sums.graph().degree(i);
      measure.num_edges += 0.5 * ends;
      measure.objective += 0.5 * sums.cost(i);
    }
    measure.weight = measure.total_weight;
    constexpr double more = 20.0;  // parts of the edges (sums_at_nodes), squares of a vector
    add_rounding(most_ends + static_cast<double>(components.nodes[c].size()) + more, measure);
  }
  return measures;
}

/// Whether there may be an edge that does not count for all that it weighs.
inline bool is_uneven(const MeasurementGraph& graph) {
  return graph.max_weight() > most_of_lightest * graph.min_weight();
}

/// Edge by edge. Of the edges of gravity only what is left at the best heading is counted.
inline std::vector<Measure> measure_by_edges(const ResidualQuaternions& residuals,
                                             const Components& components,
                                             const GravityPairs& gravity) {
  const MeasurementGraph& graph = residuals.graph();
  const auto size = components.nodes.size();
  // Parts of the edges, each with sums of its own, where there are not many components.
  constexpr std::size_t few = 100;
  const Index parts = size <= few ? 16 : 1, m = graph.num_edges();
  std::vector<std::vector<Measure>> of_part(parts, std::vector<Measure>(size));
  const auto begin_of = [&](Index part) {
    return static_cast<Index>(static_cast<long long>(m) * part / parts);
  };
  parallel_for(parts, residuals.num_threads(), [&](Index part) {
    const Index begin = begin_of(part), end = begin_of(part + 1);
    // What is of a pair is counted with its first edge.
    auto pair = std::lower_bound(gravity.first.begin(), gravity.first.end(), begin - 1);
    for (Index k = begin; k < end; ++k) {
      Measure& measure = of_part[part][components.label[graph.quaternion_edges()[k].i]];
      const Vector4& e = residuals()[k];
      const double weight = e.squaredNorm();
      measure.total_weight += weight;
      measure.num_edges += 1.0;
      measure.lightest = std::min(measure.lightest, weight);
      if (pair == gravity.first.end() || k < *pair) {
        measure.objective += 8.0 * e.head<3>().squaredNorm();
      } else if (k == *pair) {
        measure.objective += gravity.cost(e);
        measure.constant += gravity.constant(e);
      } else {
        ++pair;  // the second edge of the pair is in the cost of the first
      }
    }
  });
  std::vector<Measure> measures(size);
  for (const auto& part : of_part) {
    for (std::size_t c = 0; c < size; ++c) measures[c] += part[c];
  }
  for (Measure& measure : measures) {
    add_rounding(measure.num_edges, measure);
    measure.weight = measure.total_weight;
  }
  if (!is_uneven(graph)) return measures;
  for (Measure& measure : measures) measure.weight = 0.0;
  for (Index k = 0; k < m; ++k) {
    const Index c = components.label[graph.quaternion_edges()[k].i];
    measures[c].weight += counted_weight(residuals()[k].squaredNorm(), measures[c].lightest);
  }
  return measures;
}

inline std::vector<Measure> measure_components(const NodeSums& sums, const Components& components,
                                               const GravityPairs& gravity) {
  if (gravity.first.empty() && !is_uneven(sums.graph())) return measure_by_nodes(sums, components);
  return measure_by_edges(sums.residuals(), components, gravity);
}

}  // namespace detail

ROTAVG_INLINE Certificate certify(const MeasurementGraph& graph, const Rotations& R,
                                  const Components& components,
                                  std::vector<Elimination>& eliminations,
                                  const CertificateOptions& options,
                                  const std::vector<LowerBound>& known, const GravityPairs& gravity,
                                  std::vector<KnownCut>* cuts) {
  check(options);
  const int num_threads = resolve_num_threads(options.num_threads, graph.num_edges());

  const Quaternions q = to_quaternions(R);
  const ResidualQuaternions residuals(graph, q, num_threads);
  const NodeSums sums(residuals);
  const auto measures = detail::measure_components(sums, components, gravity);
  std::vector<ComponentCertificate> parts;
  if (cuts) cuts->resize(static_cast<std::size_t>(components.size()));
  for (Index c = 0; c < components.size(); ++c) {
    ComponentCertificate part;
    if (components.nodes[c].size() < 2) {  // every rotation is optimal
      part = {Verdict::proved, CertificateMethod::factorization, 0.0, 0.0, 0.0};
    } else {
      const CertificateMatrix S(sums, components, c);
      const double resolution = measures[c].scale() * options.tolerance;
      const ComponentBound bound =
          ComponentBounds(S, q, eliminations[c], resolution, measures[c].noise(), gravity, options,
                          cuts ? &(*cuts)[c] : nullptr)();
      part = detail::certify_component(bound, known.empty() ? LowerBound{} : known[c], measures[c],
                                       options.tolerance);
    }
    parts.push_back(part);
  }
  Certificate certificate = detail::certificate_of(std::move(parts), options.tolerance);
  const bool stopped = options.keep_going && !options.keep_going();
  if (stopped) certificate.shortfall = detail::shortfall_if_stopped(certificate);
  return certificate;
}

ROTAVG_INLINE Certificate certify(const MeasurementGraph& graph, const Rotations& given,
                                  const CertificateOptions& options) {
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations =
      grounded_eliminations(graph, components, resolve_num_threads(options.num_threads));
  return certify(graph, checked_rotations(graph, given), components, eliminations, options);
}

}  // namespace rotavg

#pragma GCC diagnostic pop

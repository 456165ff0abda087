#include <optional>
#include <stdexcept>

#include <pybind11/stl.h>

#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/uncertainty/covariance.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "covariances.hpp"

namespace rotavg_python {
namespace {

using rotavg::Index;
using rotavg::MeasurementGraph;

/// @returns the covariances (k, 3, 3), or None where f has no strict minimum
py::object covariances(const MeasurementGraph& graph, const DoubleArray& rotations,
                       const IndexArray& pairs, double noise_variance,
                       const std::optional<DoubleArray>& information, int num_threads) {
  const auto R = rotavg::checked_rotations(graph, to_rotations(rotations, "rotations"));
  const auto wanted = node_pairs(pairs, graph.num_nodes());
  rotavg::CovarianceOptions options;
  options.noise_variance = noise_variance;
  options.num_threads = num_threads;
  if (information) {
    options.information = to_rotations(*information, "information");
    if (static_cast<Index>(options.information.size()) != graph.num_edges()) {
      throw std::invalid_argument("information must have one matrix for each edge");
    }
  }
  return covariances_or_none(options, [&](const rotavg::CovarianceOptions& checked) {
    return rotavg::covariances(graph, R, wanted, checked);
  });
}

}  // namespace

void bind_uncertainty(py::module_& m) {
  m.def("covariances", &covariances, py::arg("graph"), py::arg("rotations"), py::arg("pairs"),
        py::kw_only(), py::arg("noise_variance"), py::arg("information"), py::arg("num_threads"));
}

}  // namespace rotavg_python

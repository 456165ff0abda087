#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/uncertainty/covariance.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "interrupt.hpp"

namespace rotavg_python {
namespace {

using rotavg::Index;
using rotavg::MeasurementGraph;

std::vector<rotavg::NodePair> node_pairs(const IndexArray& array, Index num_nodes) {
  if (array.ndim() != 2 || array.shape(1) != 2) {
    throw std::invalid_argument("pairs must have the shape (k, 2)");
  }
  const auto rows = array.unchecked<2>();
  std::vector<rotavg::NodePair> pairs(static_cast<std::size_t>(array.shape(0)));
  for (py::ssize_t k = 0; k < array.shape(0); ++k) {
    for (py::ssize_t end = 0; end < 2; ++end) {
      if (rows(k, end) < 0 || rows(k, end) >= num_nodes) {
        throw std::out_of_range("there is no such node");
      }
    }
    pairs[static_cast<std::size_t>(k)] = {rows(k, 0), rows(k, 1)};
  }
  return pairs;
}

/// @returns the covariances (k, 3, 3), or None where f has no strict minimum
py::object covariances(const MeasurementGraph& graph, const DoubleArray& rotations,
                       const IndexArray& pairs, double noise_variance,
                       const std::vector<Index>& held_nodes, const std::vector<Index>& turn_of,
                       const DoubleArray& axis, const std::optional<DoubleArray>& information,
                       int num_threads) {
  const auto R = rotavg::checked_rotations(graph, to_rotations(rotations, "rotations"));
  const auto wanted = node_pairs(pairs, graph.num_nodes());
  SignalCheck signals;
  rotavg::CovarianceOptions options;
  options.noise_variance = noise_variance;
  options.num_threads = num_threads;
  options.keep_going = signals.keep_going();
  if (axis.size() != 3) throw std::invalid_argument("the axis must have three entries");
  for (const Index node : held_nodes) {
    options.free_turns.push_back({node, rotavg::Vector3(axis.data())});
  }
  options.turn_of = turn_of;
  if (information) {
    options.information = to_rotations(*information, "information");
    if (static_cast<Index>(options.information.size()) != graph.num_edges()) {
      throw std::invalid_argument("information must have one matrix for each edge");
    }
  }
  const auto result = without_gil([&] { return rotavg::covariances(graph, R, wanted, options); });
  signals.rethrow();
  if (result.status != rotavg::CovarianceStatus::computed) return py::none();
  return from_rotations(result.pairs);
}

}  // namespace

void bind_uncertainty(py::module_& m) {
  m.def("covariances", &covariances, py::arg("graph"), py::arg("rotations"), py::arg("pairs"),
        py::kw_only(), py::arg("noise_variance"), py::arg("held_nodes"), py::arg("turn_of"),
        py::arg("axis"), py::arg("information"), py::arg("num_threads"));
}

}  // namespace rotavg_python

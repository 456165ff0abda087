#include <algorithm>
#include <vector>

#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/robust/cycles.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "interrupt.hpp"

namespace rotavg_python {
namespace {

using rotavg::Index;
using rotavg::MeasurementGraph;

py::tuple cycle_evidence(const MeasurementGraph& graph, double threshold) {
  SignalCheck signals;
  const auto evidence =
      without_gil([&] { return rotavg::cycle_evidence(graph, threshold, signals.keep_going()); });
  signals.rethrow();
  std::vector<Index> checked, agreeing;
  std::vector<double> median, least;
  for (const rotavg::CycleEvidence& e : evidence) {
    checked.push_back(e.checked);
    agreeing.push_back(e.agreeing);
    median.push_back(e.median_error);
    least.push_back(e.least_error);
  }
  return py::make_tuple(from_vector(checked), from_vector(agreeing), from_vector(median),
                        from_vector(least));
}

py::array_t<bool> bridges(const MeasurementGraph& graph) {
  const std::vector<bool> is_bridge = without_gil([&] { return rotavg::bridges(graph); });
  py::array_t<bool> result(static_cast<py::ssize_t>(is_bridge.size()));
  std::copy(is_bridge.begin(), is_bridge.end(), result.mutable_data());
  return result;
}

/// The series of every edge, -1 for bridges, and the number of independent cycles.
py::tuple series(const MeasurementGraph& graph) {
  const rotavg::Series series = without_gil([&] { return rotavg::series_of(graph); });
  return py::make_tuple(from_vector(series.label), series.num_cycles);
}

}  // namespace

void bind_robust(py::module_& m) {
  m.def("cycle_evidence", &cycle_evidence, py::arg("graph"), py::arg("threshold"));
  m.def("bridges", &bridges, py::arg("graph"));
  m.def("series", &series, py::arg("graph"));
}

}  // namespace rotavg_python

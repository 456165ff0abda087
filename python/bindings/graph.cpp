#include <memory>

#include <rotavg/graph/algebraic_connectivity.hpp>
#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "errors.hpp"
#include "interrupt.hpp"

namespace rotavg_python {
namespace {

using rotavg::Index;
using rotavg::MeasurementGraph;

std::unique_ptr<MeasurementGraph> make_graph(Index num_nodes, const IndexArray& indices,
                                             const DoubleArray& rotations,
                                             const DoubleArray& weights) {
  const rotavg::Rotations i_from_j = to_rotations(rotations, "rotations");
  const auto m = static_cast<py::ssize_t>(i_from_j.size());
  if (indices.ndim() != 2 || indices.shape(0) != m || indices.shape(1) != 2 ||
      weights.ndim() != 1 || weights.shape(0) != m) {
    throw std::invalid_argument(
        "indices (m, 2), rotations (m, 3, 3) and weights (m,) do not match");
  }
  std::vector<rotavg::RelativeRotation> measurements(i_from_j.size());
  const auto ends = indices.unchecked<2>();
  const auto weight = weights.unchecked<1>();
  for (py::ssize_t k = 0; k < m; ++k) {
    measurements[static_cast<std::size_t>(k)] = {ends(k, 0), ends(k, 1),
                                                 i_from_j[static_cast<std::size_t>(k)], weight(k)};
  }
  std::vector<rotavg::NodeId> nodes(static_cast<std::size_t>(num_nodes));
  for (std::size_t k = 0; k < nodes.size(); ++k) nodes[k] = static_cast<rotavg::NodeId>(k);
  const py::gil_scoped_release release;
  return std::make_unique<MeasurementGraph>(measurements, std::move(nodes));
}

py::array_t<double> snapped_rotations(const MeasurementGraph& graph) {
  rotavg::Rotations rotations;
  rotations.reserve(graph.edges().size());
  for (const rotavg::Edge& e : graph.edges()) rotations.push_back(e.i_from_j);
  return from_rotations(rotations);
}

double connectivity(const MeasurementGraph& graph, Index component) {
  SignalCheck signals;
  double result = 0.0;
  {
    const py::gil_scoped_release release;
    const rotavg::Components components = rotavg::connected_components(graph);
    result = rotavg::algebraic_connectivity(graph, components, component, signals.keep_going());
  }
  signals.rethrow();
  return result;
}

std::vector<Index> cycle_lengths(const MeasurementGraph& graph, const std::vector<Index>& edges) {
  const rotavg::BreadthFirstForest forest = rotavg::breadth_first_forest(graph);
  std::vector<Index> lengths;
  lengths.reserve(edges.size());
  for (const Index k : edges) {
    if (k < 0 || k >= graph.num_edges()) throw std::out_of_range("there is no such edge");
    lengths.push_back(rotavg::fundamental_cycle_length(graph, forest, k));
  }
  return lengths;
}

py::tuple invalid_edge_arguments(const rotavg::InvalidEdge& error) {
  return py::make_tuple(error.edge(), error.reason());
}

}  // namespace

void bind_graph(py::module_& m) {
  register_error<rotavg::InvalidEdge, invalid_edge_arguments>(m, "InvalidEdge");

  py::class_<MeasurementGraph>(m, "MeasurementGraph")
      .def(py::init(&make_graph), py::arg("num_nodes"), py::arg("indices"), py::arg("rotations"),
           py::arg("weights"))
      .def_property_readonly("num_nodes", &MeasurementGraph::num_nodes)
      .def_property_readonly("num_edges", &MeasurementGraph::num_edges)
      .def_property_readonly("rotations", &snapped_rotations);

  m.def(
      "components",
      [](const MeasurementGraph& graph) {
        return from_vector(rotavg::connected_components(graph).label);
      },
      py::arg("graph"));
  m.def("algebraic_connectivity", &connectivity, py::arg("graph"), py::arg("component"));
  m.def(
      "cycle_lengths",
      [](const MeasurementGraph& graph, const IndexArray& edges) {
        return from_vector(
            cycle_lengths(graph, std::vector<Index>(edges.data(), edges.data() + edges.size())));
      },
      py::arg("graph"), py::arg("edges"));
}

}  // namespace rotavg_python

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include <Eigen/Core>

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

using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

/// The graph of measurements in these arrays, read where they stand.
/// @param rotations matrices (m, 3, 3), or quaternions xyzw (m, 4)
/// @param inverted whether these are R_ji
std::unique_ptr<MeasurementGraph> make_graph(Index num_nodes, const IndexArray& indices,
                                             const DoubleArray& rotations,
                                             const DoubleArray& weights, bool inverted) {
  const bool matrices = rotations.ndim() == 3 && rotations.shape(1) == 3 && rotations.shape(2) == 3;
  const bool quaternions = rotations.ndim() == 2 && rotations.shape(1) == 4;
  const py::ssize_t m = rotations.ndim() > 0 ? rotations.shape(0) : 0;
  if (!(matrices || quaternions) || indices.ndim() != 2 || indices.shape(0) != m ||
      indices.shape(1) != 2 || weights.ndim() != 1 || weights.shape(0) != m) {
    throw std::invalid_argument(
        "indices (m, 2), rotations (m, 3, 3) or (m, 4), and weights (m,) do not match");
  }
  const Index* const ends = indices.data();
  const double *const rotation = rotations.data(), *const weight = weights.data();
  const auto matrix = [=](std::size_t k) -> rotavg::RelativeRotation {
    const Eigen::Map<const RowMajor> R(rotation + 9 * k);
    rotavg::RelativeRotation result{ends[2 * k], ends[2 * k + 1], R, weight[k]};
    if (inverted) result.i_from_j.transposeInPlace();
    return result;
  };
  const auto quaternion = [=](std::size_t k) -> rotavg::RelativeQuaternion {
    const double* const q = rotation + 4 * k;
    const double sign = inverted ? -1.0 : 1.0;
    return {ends[2 * k], ends[2 * k + 1], {q[3], sign * q[0], sign * q[1], sign * q[2]}, weight[k]};
  };
  const WithoutGil release;
  std::vector<rotavg::NodeId> nodes(static_cast<std::size_t>(num_nodes));
  std::iota(nodes.begin(), nodes.end(), rotavg::NodeId{0});
  const auto count = static_cast<std::size_t>(m);
  if (matrices) return std::make_unique<MeasurementGraph>(count, matrix, std::move(nodes));
  return std::make_unique<MeasurementGraph>(count, quaternion, std::move(nodes));
}

/// What `write(edge, place)` writes of every edge, so many values each, as an array of this shape.
template <typename T, typename Write>
py::array_t<T> of_edges(const MeasurementGraph& graph, std::vector<py::ssize_t> rest,
                        Write&& write) {
  std::vector<py::ssize_t> shape{graph.num_edges()};
  shape.insert(shape.end(), rest.begin(), rest.end());
  py::array_t<T> result(std::move(shape));
  T* place = result.mutable_data();
  const py::ssize_t size = result.size() / std::max<py::ssize_t>(graph.num_edges(), 1);
  const WithoutGil release;
  for (const rotavg::Edge& e : graph.edges()) {
    write(e, place);
    place += size;
  }
  return result;
}

py::array_t<double> snapped_rotations(const MeasurementGraph& graph) {
  return of_edges<double>(graph, {3, 3}, [](const rotavg::Edge& e, double* place) {
    Eigen::Map<RowMajor>{place} = e.i_from_j();
  });
}

/// xyzw, of the two signs the one with w > 0, or else with the first other entry that is not zero.
py::array_t<double> quaternions(const MeasurementGraph& graph) {
  return of_edges<double>(graph, {4}, [](const rotavg::Edge& e, double* place) {
    rotavg::WeightedQuaternion q = e.quaternion;
    const double length = q.norm();
    if (std::abs(length - 1.0) > 1e-15) q.coeffs() /= length;
    double first = q.w();
    for (int k = 0; k < 3 && first == 0.0; ++k) first = q.coeffs()[k];
    const double sign = first < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 4; ++k) place[k] = sign * q.coeffs()[k] + 0.0;  // not -0
  });
}

/// xyzw, as they are held.
py::array_t<double> scaled_quaternions(const MeasurementGraph& graph) {
  return of_edges<double>(graph, {4}, [](const rotavg::Edge& e, double* place) {
    Eigen::Map<rotavg::Vector4>{place} = e.quaternion.coeffs();
  });
}

py::array_t<Index> indices(const MeasurementGraph& graph) {
  return of_edges<Index>(graph, {2}, [](const rotavg::Edge& e, Index* place) {
    place[0] = e.i;
    place[1] = e.j;
  });
}

double connectivity(const MeasurementGraph& graph, Index component) {
  SignalCheck signals;
  double result = 0.0;
  {
    const WithoutGil release;
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
           py::arg("weights"), py::arg("inverted") = false)
      .def_property_readonly("num_nodes", &MeasurementGraph::num_nodes)
      .def_property_readonly("num_edges", &MeasurementGraph::num_edges)
      .def_property_readonly("bytes", &MeasurementGraph::bytes)
      .def_property_readonly("rotations", &snapped_rotations)
      .def_property_readonly("quaternions", &quaternions)
      .def_property_readonly("scaled_quaternions", &scaled_quaternions)
      .def_property_readonly("indices", &indices)
      .def_property_readonly(
          "weights", [](const MeasurementGraph& graph) { return from_vector(graph.weights()); });

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

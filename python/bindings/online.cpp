#include <optional>
#include <string>
#include <vector>

#include <pybind11/stl.h>

#include <rotavg/online/online.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "names.hpp"

namespace rotavg_python {
namespace {

using IdArray = py::array_t<rotavg::NodeId, py::array::c_style | py::array::forcecast>;

std::vector<rotavg::Index> to_indices(const IndexArray& values) {
  return std::vector<rotavg::Index>(values.data(), values.data() + values.size());
}

rotavg::Online make_online(double tolerance, double certificate_tolerance, const std::string& loss,
                           double loss_scale, bool second_opinions) {
  rotavg::OnlineOptions options;
  options.tolerance = tolerance;
  options.certificate_tolerance = certificate_tolerance;
  options.loss = value_of<rotavg::Loss>(loss);
  options.loss_scale = loss_scale;
  options.second_opinions = second_opinions;
  return rotavg::Online(options);
}

py::array_t<rotavg::Index> add(rotavg::Online& online, const IdArray& ends,
                               const DoubleArray& rotations, const DoubleArray& weights,
                               const std::optional<Mask>& trusted, const IdArray& nodes) {
  const rotavg::Rotations R = to_rotations(rotations, "rotations");
  std::vector<rotavg::RelativeRotation> edges;
  for (std::size_t k = 0; k < R.size(); ++k) {
    edges.push_back({ends.data()[2 * k], ends.data()[2 * k + 1], R[k], weights.data()[k]});
  }
  std::vector<bool> mask;
  if (trusted) mask.assign(trusted->data(), trusted->data() + trusted->size());
  const std::vector<rotavg::NodeId> ids(nodes.data(), nodes.data() + nodes.size());
  return from_vector(without_gil([&] { return online.add(edges, mask, ids); }));
}

void set_weights(rotavg::Online& online, const IndexArray& edges, const DoubleArray& weights) {
  const std::vector<rotavg::Index> numbers = to_indices(edges);
  const std::vector<double> values(weights.data(), weights.data() + weights.size());
  without_gil([&] { online.set_weights(numbers, values); });
}

py::tuple edges(const rotavg::Online& online) {
  std::vector<rotavg::Index> numbers;
  const auto edges = online.edges(numbers);
  py::array_t<rotavg::NodeId> ends({static_cast<py::ssize_t>(edges.size()), py::ssize_t{2}});
  rotavg::Rotations R;
  std::vector<double> weights;
  for (std::size_t k = 0; k < edges.size(); ++k) {
    ends.mutable_data()[2 * k] = edges[k].i;
    ends.mutable_data()[2 * k + 1] = edges[k].j;
    R.push_back(edges[k].i_from_j);
    weights.push_back(edges[k].weight);
  }
  return py::make_tuple(from_vector(numbers), ends, from_rotations(R), from_vector(weights));
}

}  // namespace

void bind_online(py::module_& m) {
  using rotavg::Online;
  using rotavg::OnlineState;
  py::class_<OnlineState>(m, "OnlineState")
      .def_property_readonly("verdict", [](const OnlineState& s) { return name_of(s.verdict); })
      .def_readonly("objective", &OnlineState::objective)
      .def_readonly("gap", &OnlineState::gap)
      .def_readonly("relative_gap", &OnlineState::relative_gap)
      .def_readonly("relative_gradient", &OnlineState::relative_gradient)
      .def_readonly("num_nodes", &OnlineState::num_nodes)
      .def_readonly("num_edges", &OnlineState::num_edges)
      .def_readonly("num_components", &OnlineState::num_components)
      .def_readonly("num_outliers", &OnlineState::num_outliers)
      .def_readonly("iterations", &OnlineState::iterations)
      .def_readonly("eliminated", &OnlineState::eliminated)
      .def_readonly("moved", &OnlineState::moved)
      .def_readonly("refreshed", &OnlineState::refreshed)
      .def_readonly("solved", &OnlineState::solved)
      .def_readonly("num_second_opinions", &OnlineState::num_second_opinions);
  py::class_<Online>(m, "Online")
      .def(py::init(&make_online), py::kw_only(), py::arg("tolerance"),
           py::arg("certificate_tolerance"), py::arg("loss"), py::arg("loss_scale"),
           py::arg("second_opinions"))
      .def("add", &add, py::arg("ends"), py::arg("rotations"), py::arg("weights"),
           py::arg("trusted"), py::arg("nodes"))
      .def("remove",
           [](Online& online, const IndexArray& edges) {
             const auto numbers = to_indices(edges);
             without_gil([&] { online.remove(numbers); });
           })
      .def("set_weights", &set_weights)
      .def_property_readonly("state", [](const Online& online) { return online.state(); })
      .def("nodes", [](const Online& online) { return from_vector(online.nodes()); })
      .def("rotations", [](const Online& online) { return from_rotations(online.rotations()); })
      .def("rotation", [](const Online& online,
                          rotavg::NodeId node) { return from_rotations({online.rotation(node)}); })
      .def("edge_weights", [](const Online& online) { return from_vector(online.edge_weights()); })
      .def("edges", &edges);
}

}  // namespace rotavg_python

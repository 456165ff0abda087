#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include <rotavg/poses/positions.hpp>

#include "bindings.hpp"
#include "convert.hpp"

namespace rotavg_python {
namespace {

using rotavg::MeasurementGraph;

/// (k, 3) as k vectors.
std::vector<rotavg::Vector3> to_vectors(const DoubleArray& array, const char* name) {
  if (array.ndim() != 2 || array.shape(1) != 3) {
    throw std::invalid_argument(std::string(name) + " must have the shape (k, 3)");
  }
  std::vector<rotavg::Vector3> result;
  const double* data = array.data();
  for (py::ssize_t k = 0; k < array.shape(0); ++k, data += 3) {
    result.emplace_back(data[0], data[1], data[2]);
  }
  return result;
}

py::array_t<double> from_vectors(const std::vector<rotavg::Vector3>& vectors) {
  py::array_t<double> result({static_cast<py::ssize_t>(vectors.size()), py::ssize_t{3}});
  double* data = result.mutable_data();
  for (const rotavg::Vector3& v : vectors) {
    for (int k = 0; k < 3; ++k) *data++ = v(k);
  }
  return result;
}

/// @param rows (k,) of nodes whose positions are held
/// @param held (k, 3) where
py::array_t<double> positions(const MeasurementGraph& graph, const DoubleArray& rotations,
                              const DoubleArray& translations, const DoubleArray& information,
                              const IndexArray& rows, const DoubleArray& held) {
  const auto R = to_rotations(rotations, "rotations");
  const auto t = to_vectors(translations, "translations");
  const auto omega = to_rotations(information, "information");
  const auto where = to_vectors(held, "held");
  if (rows.ndim() != 1 || static_cast<std::size_t>(rows.shape(0)) != where.size()) {
    throw std::invalid_argument("rows must have one entry for each position that is held");
  }
  std::vector<rotavg::FixedPosition> fixed;
  for (std::size_t k = 0; k < where.size(); ++k) {
    const rotavg::Index row = rows.at(static_cast<py::ssize_t>(k));
    if (row < 0 || row >= graph.num_nodes()) throw std::invalid_argument("rows are out of range");
    fixed.push_back({graph.nodes()[static_cast<std::size_t>(row)], where[k]});
  }
  return from_vectors(without_gil([&] { return rotavg::positions(graph, R, t, omega, fixed); }));
}

}  // namespace

void bind_poses(py::module_& m) {
  m.def("positions", &positions, py::arg("graph"), py::arg("rotations"), py::arg("translations"),
        py::arg("information"), py::arg("rows"), py::arg("held"));
}

}  // namespace rotavg_python

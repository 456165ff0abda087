#pragma once

// numpy arrays in C order <-> the library's vectors. Shapes are checked here, values by the
// library.

#include <stdexcept>
#include <string>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <rotavg/types.hpp>

#include "gil.hpp"

namespace rotavg_python {

namespace py = pybind11;

using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;
using IndexArray = py::array_t<rotavg::Index, py::array::c_style | py::array::forcecast>;
using Mask = py::array_t<bool, py::array::c_style | py::array::forcecast>;

inline rotavg::Rotations to_rotations(const DoubleArray& array, const char* name) {
  if (array.ndim() != 3 || array.shape(1) != 3 || array.shape(2) != 3) {
    throw std::invalid_argument(std::string(name) + " must have the shape (n, 3, 3)");
  }
  rotavg::Rotations result(static_cast<std::size_t>(array.shape(0)));
  const double* data = array.data();
  for (rotavg::Matrix3& R : result) {
    R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(data);
    data += 9;
  }
  return result;
}

inline py::array_t<double> from_rotations(const rotavg::Rotations& rotations) {
  py::array_t<double> result(
      {static_cast<py::ssize_t>(rotations.size()), py::ssize_t{3}, py::ssize_t{3}});
  double* data = result.mutable_data();
  for (const rotavg::Matrix3& R : rotations) {
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{data} = R;
    data += 9;
  }
  return result;
}

/// What f returns, called without the GIL.
template <typename Function>
auto without_gil(Function&& f) {
  const WithoutGil release;
  return f();
}

template <typename T>
py::array_t<T> from_vector(const std::vector<T>& values) {
  return py::array_t<T>(static_cast<py::ssize_t>(values.size()), values.data());
}

}  // namespace rotavg_python

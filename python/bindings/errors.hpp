#pragma once

// Exceptions of the library -> Python classes with arguments that the package can take apart.

#include <exception>

#include <pybind11/gil_safe_call_once.h>
#include <pybind11/pybind11.h>

namespace rotavg_python {

namespace py = pybind11;

/// Makes a Python class, a ValueError, for the C++ exception `Error`. Its args are what `arguments`
/// makes of the exception: a tuple.
template <typename Error, py::tuple (*arguments)(const Error&)>
void register_error(py::module_& m, const char* name) {
  PYBIND11_CONSTINIT static py::gil_safe_call_once_and_store<py::object> storage;
  storage.call_once_and_store_result(
      [&]() -> py::object { return py::exception<Error>(m, name, PyExc_ValueError); });
  py::register_local_exception_translator([](std::exception_ptr p) {
    try {
      if (p) std::rethrow_exception(p);
    } catch (const Error& error) {
      PyErr_SetObject(storage.get_stored().ptr(), arguments(error).ptr());
    }
  });
}

}  // namespace rotavg_python

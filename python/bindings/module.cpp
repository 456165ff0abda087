#include <pybind11/pybind11.h>

#include <rotavg/version.hpp>

#include "bindings.hpp"

PYBIND11_MODULE(ROTAVG_CORE, m) {
  m.doc() = "The C++ core of rotavg. Use the package `rotavg`, which checks and documents it.";
  m.attr("__version__") = ROTAVG_VERSION;
  rotavg_python::bind_graph(m);
  rotavg_python::bind_priors(m);
  rotavg_python::bind_solve(m);
  rotavg_python::bind_anisotropic(m);
  rotavg_python::bind_certify(m);
  rotavg_python::bind_online(m);
  rotavg_python::bind_poses(m);
  rotavg_python::bind_robust(m);
  rotavg_python::bind_uncertainty(m);
}

#pragma once

#include <pybind11/pybind11.h>

namespace rotavg_python {

void bind_graph(pybind11::module_& m);
void bind_solve(pybind11::module_& m);
void bind_anisotropic(pybind11::module_& m);
void bind_certify(pybind11::module_& m);
void bind_online(pybind11::module_& m);
void bind_poses(pybind11::module_& m);
void bind_priors(pybind11::module_& m);
void bind_robust(pybind11::module_& m);
void bind_uncertainty(pybind11::module_& m);

}  // namespace rotavg_python

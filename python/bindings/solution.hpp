#pragma once

// What all solvers tell Python.

#include <vector>

#include <rotavg/solve/solution.hpp>

#include "convert.hpp"
#include "names.hpp"

namespace rotavg_python {

inline py::dict trace_dict(const std::vector<rotavg::Progress>& trace) {
  const auto column = [&](auto member) {
    std::vector<double> values;
    values.reserve(trace.size());
    for (const rotavg::Progress& p : trace) values.push_back(p.*member);
    return from_vector(values);
  };
  py::dict result;
  result["objective"] = column(&rotavg::Progress::objective);
  result["gradient_norm"] = column(&rotavg::Progress::gradient_norm);
  result["relative_gradient"] = column(&rotavg::Progress::relative_gradient);
  result["step"] = column(&rotavg::Progress::step);
  result["seconds"] = column(&rotavg::Progress::seconds);
  return result;
}

inline py::dict solution_dict(const rotavg::Solution& s) {
  py::dict result;
  result["rotations"] = from_rotations(s.rotations);
  result["objective"] = s.objective;
  result["gradient_norm"] = s.gradient_norm;
  result["relative_gradient"] = s.relative_gradient;
  result["status"] = name_of(s.status);
  result["iterations"] = s.iterations;
  result["trace"] = trace_dict(s.trace);
  result["method"] = name_of(s.method);
  result["reason"] = s.reason;
  result["init"] = name_of(s.init);
  result["component"] = from_vector(s.components.label);
  result["certificate"] = certificate_dict(s.certificate);
  result["seconds"] = py::dict(py::arg("init") = s.timings.init, py::arg("solve") = s.timings.solve,
                               py::arg("certify") = s.timings.certify);
  return result;
}

}  // namespace rotavg_python

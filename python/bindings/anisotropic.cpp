#include <optional>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/solve/stopwatch.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "interrupt.hpp"
#include "names.hpp"
#include "solution.hpp"

namespace rotavg_python {
namespace {

using rotavg::MeasurementGraph;

/// @param precisions (m, 3, 3) of the edges
/// @param start (n, 3, 3), where a solution without covariances has ended
py::dict solve_anisotropic(const MeasurementGraph& graph, const DoubleArray& precisions,
                           const DoubleArray& start, const std::string& method,
                           const std::string& mu, const std::string& stop, double tolerance,
                           int max_iterations, double time_limit, int num_threads, bool certify,
                           double certificate_tolerance, double certificate_max_flops,
                           const std::optional<py::function>& callback, int iterations_before,
                           const rotavg::GroundedGraph* priors) {
  SignalCheck signals;
  rotavg::SolveOptions options;
  options.method = value_of<rotavg::Method>(method);
  options.mu = value_of<rotavg::MuRule>(mu);
  options.certify = certify;
  options.certificate.tolerance = certificate_tolerance;
  options.certificate.max_factorization_flops = certificate_max_flops;
  options.iteration.stop = value_of<rotavg::StopRule>(stop);
  options.iteration.tolerance = tolerance;
  options.iteration.max_iterations = max_iterations;
  options.iteration.time_limit = time_limit;
  options.iteration.num_threads = num_threads;
  options.iteration.keep_going = signals.keep_going();
  if (callback) {
    options.iteration.callback = [call = calling(*callback),
                                  iterations_before](rotavg::Progress progress) {
      if (progress.iteration == 0) return true;  // told at the end of what came before
      progress.iteration += iterations_before;
      return call(progress);
    };
  }
  const std::vector<rotavg::Matrix3> H = to_rotations(precisions, "precisions");
  rotavg::Rotations R = to_rotations(start, "start");
  const rotavg::Solution solution = without_gil([&] {
    if (priors) return rotavg::solve(*priors, H, options, R);
    return rotavg::solve(rotavg::AnisotropicGraph(graph, H), options, std::move(R));
  });
  const bool interrupted = signals.is_keyboard_interrupt() && rotavg::is_converged(solution.status);
  if (!interrupted) signals.rethrow();
  py::dict result = solution_dict(solution);
  result["interrupted"] = interrupted;
  return result;
}

py::dict certify_anisotropic(const MeasurementGraph& graph, const DoubleArray& precisions,
                             const DoubleArray& rotations, double tolerance, double max_flops,
                             double time_limit, int num_threads) {
  const rotavg::Rotations R = to_rotations(rotations, "rotations");
  const std::vector<rotavg::Matrix3> H = to_rotations(precisions, "precisions");
  SignalCheck signals;
  const rotavg::Stopwatch watch;
  rotavg::CertificateOptions options;
  options.tolerance = tolerance;
  options.max_factorization_flops = max_flops;
  options.num_threads = num_threads;
  options.keep_going = [&, check = signals.keep_going()] {
    return watch.seconds() < time_limit && check();
  };
  const rotavg::Certificate certificate =
      without_gil([&] { return rotavg::certify(rotavg::AnisotropicGraph(graph, H), R, options); });
  signals.rethrow();
  return certificate_dict(certificate);
}

}  // namespace

void bind_anisotropic(py::module_& m) {
  m.def("solve_anisotropic", &solve_anisotropic, py::arg("graph"), py::arg("precisions"),
        py::kw_only(), py::arg("start"), py::arg("method"), py::arg("mu"), py::arg("stop"),
        py::arg("tolerance"), py::arg("max_iterations"), py::arg("time_limit"),
        py::arg("num_threads"), py::arg("certify"), py::arg("certificate_tolerance"),
        py::arg("certificate_max_flops"), py::arg("callback"), py::arg("iterations_before"),
        py::arg("priors").none(true));
  m.def("certify_anisotropic", &certify_anisotropic, py::arg("graph"), py::arg("precisions"),
        py::arg("rotations"), py::kw_only(), py::arg("tolerance"), py::arg("max_flops"),
        py::arg("time_limit"), py::arg("num_threads"));
}

}  // namespace rotavg_python

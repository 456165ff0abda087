#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/solve.hpp>
#include <rotavg/anisotropic/with_priors.hpp>
#include <rotavg/reduction/grounded_graph.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "interrupt.hpp"
#include "names.hpp"
#include "options.hpp"
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
                           int max_rank, double certificate_tolerance,
                           double certificate_failure_probability, std::uint64_t certificate_seed,
                           double certificate_max_flops,
                           const std::optional<py::function>& callback, int iterations_before,
                           const rotavg::GroundedGraph* priors, double prior_precision) {
  SignalCheck signals;
  rotavg::SolveOptions options;
  options.method = value_of<rotavg::Method>(method);
  options.mu = value_of<rotavg::MuRule>(mu);
  options.certify = certify;
  options.max_rank = max_rank;
  options.certificate = certificate_options(certificate_tolerance, certificate_failure_probability,
                                            certificate_seed, certificate_max_flops);
  options.iteration = iteration_options(tolerance, max_iterations, time_limit, num_threads,
                                        callback, signals, iterations_before);
  options.iteration.stop = value_of<rotavg::StopRule>(stop);
  const std::vector<rotavg::Matrix3> H = to_rotations(precisions, "precisions");
  rotavg::Rotations R = to_rotations(start, "start");
  const rotavg::Solution solution = without_gil([&] {
    if (priors) return rotavg::solve(*priors, {H, prior_precision}, options, R);
    return rotavg::solve(rotavg::AnisotropicGraph(graph, H), options, std::move(R));
  });
  const bool interrupted = signals.is_keyboard_interrupt() && rotavg::is_converged(solution.status);
  if (!interrupted) signals.rethrow();
  py::dict result = solution_dict(solution);
  result["interrupted"] = interrupted;
  return result;
}

}  // namespace

void bind_anisotropic(py::module_& m) {
  m.def("solve_anisotropic", &solve_anisotropic, py::arg("graph"), py::arg("precisions"),
        py::kw_only(), py::arg("start"), py::arg("method"), py::arg("mu"), py::arg("stop"),
        py::arg("tolerance"), py::arg("max_iterations"), py::arg("time_limit"),
        py::arg("num_threads"), py::arg("certify"), py::arg("max_rank"),
        py::arg("certificate_tolerance"), py::arg("certificate_failure_probability"),
        py::arg("certificate_seed"), py::arg("certificate_max_flops"), py::arg("callback"),
        py::arg("iterations_before"), py::arg("priors").none(true), py::arg("prior_precision"));
}

}  // namespace rotavg_python

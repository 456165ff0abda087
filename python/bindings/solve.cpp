#include <algorithm>
#include <optional>

#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include <rotavg/anisotropic/with_priors.hpp>
#include <rotavg/linalg/memory.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/robust/solve_rigs.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/solve_robust_with_priors.hpp>
#include <rotavg/solve/anisotropic.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/solve_with_priors.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "errors.hpp"
#include "interrupt.hpp"
#include "names.hpp"
#include "options.hpp"
#include "solution.hpp"

namespace rotavg_python {
namespace {

py::object prior_verdicts(const rotavg::PriorVerdicts& v) {
  if (v.weights.empty()) return py::none();
  py::array_t<bool> is_outlier(static_cast<py::ssize_t>(v.is_outlier.size()));
  std::copy(v.is_outlier.begin(), v.is_outlier.end(), is_outlier.mutable_data());
  return py::dict(py::arg("noise") = v.noise, py::arg("threshold") = v.threshold,
                  py::arg("weights") = from_vector(v.weights), py::arg("is_outlier") = is_outlier);
}

py::dict alternative_dict(const rotavg::Alternative& a) {
  py::list bundles, missing;
  for (const rotavg::Bundle& b : a.bundles) {
    bundles.append(py::make_tuple(b.group, b.other_group, b.edges, b.weight, b.alternative_edges,
                                  b.alternative_weight));
  }
  for (const auto& [i, j] : a.missing) missing.append(py::make_tuple(i, j));
  return py::dict(py::arg("rotations") = from_rotations(a.rotations),
                  py::arg("group") = from_vector(a.group), py::arg("bundles") = bundles,
                  py::arg("voices") = py::make_tuple(a.evidence.voices, a.evidence.other_voices),
                  py::arg("lead_in_weight") = a.evidence.lead_in_weight(),
                  py::arg("edges") = py::make_tuple(a.evidence.edges(), a.evidence.other_edges()),
                  py::arg("closure") = py::make_tuple(a.answer_closure, a.closure),
                  py::arg("missing") = missing);
}

py::dict robust_dict(const rotavg::RobustSolution& s) {
  py::list verdicts;
  for (const rotavg::EdgeVerdict verdict : s.verdicts.edges) verdicts.append(name_of(verdict));
  py::dict result;
  result["loss"] = name_of(s.loss.kind);
  result["scale"] = s.loss.scale;
  result["noise"] = s.noise;
  result["noise_shows"] = s.noise_shows;
  result["threshold"] = s.threshold;
  result["objective"] = s.robust_objective;
  result["edge_weights"] = from_vector(s.edge_weights);
  result["edge_scales"] = from_vector(s.edge_scales);
  result["edge_verdicts"] = verdicts;
  py::array_t<bool> favoured(static_cast<py::ssize_t>(s.edge_weights.size()));
  std::fill_n(favoured.mutable_data(), favoured.size(), false);
  std::copy(s.favoured.begin(), s.favoured.end(), favoured.mutable_data());
  result["is_favoured"] = favoured;
  result["part"] = from_vector(s.verdicts.part);
  result["num_strained"] = s.num_strained;
  py::list alternatives;
  for (const rotavg::Alternative& a : s.alternatives) alternatives.append(alternative_dict(a));
  result["alternatives"] = alternatives;
  result["absolute_priors"] = prior_verdicts(s.absolute);
  result["gravity_priors"] = prior_verdicts(s.gravity);
  return result;
}

py::dict rigs_dict(const rotavg::RigEstimate& rigs) {
  py::list origin, determined;
  for (const rotavg::SensorOrigin o : rigs.origin) origin.append(name_of(o));
  for (const bool d : rigs.determined) determined.append(d);
  return py::dict(py::arg("sensors") = rigs.sensors,
                  py::arg("rotations") = from_rotations(rigs.frame_from_sensor),
                  py::arg("origin") = origin, py::arg("determined") = determined,
                  py::arg("converged") = rigs.converged, py::arg("iterations") = rigs.iterations,
                  py::arg("relative_gradient") = rigs.relative_gradient,
                  py::arg("lower_bound") = rigs.lower_bound);
}

std::vector<bool> to_mask(const std::optional<Mask>& mask) {
  if (!mask) return {};
  return std::vector<bool>(mask->data(), mask->data() + mask->size());
}

std::vector<double> to_doubles(const std::optional<DoubleArray>& values) {
  if (!values) return {};
  return std::vector<double>(values->data(), values->data() + values->size());
}

py::dict solve(const rotavg::MeasurementGraph& graph, const std::string& method,
               const std::string& init, const std::optional<DoubleArray>& start, std::uint64_t seed,
               const std::string& mu, bool accelerate, int max_rank, const std::string& stop,
               double tolerance, int max_iterations, double time_limit, int num_threads,
               bool certify, double certificate_tolerance, double certificate_failure_probability,
               std::uint64_t certificate_seed, double certificate_max_flops,
               const std::optional<py::function>& callback, const std::string& loss,
               double loss_scale, double cycle_threshold, int min_cycles,
               const std::string& weight_kind, const std::optional<Mask>& trusted,
               const std::optional<Mask>& excluded, const std::optional<DoubleArray>& edge_scales,
               const std::optional<DoubleArray>& initial_weights,
               const std::optional<Mask>& odometry, bool robust_priors,
               const rotavg::GroundedGraph* priors, bool start_is_solution,
               const rotavg::Rigs* rigs, const rotavg::Priors* rig_priors) {
  SignalCheck signals;
  rotavg::SolveOptions options;
  options.method = value_of<rotavg::Method>(method);
  options.init = value_of<rotavg::Initialization>(init);
  options.seed = seed;
  options.mu = value_of<rotavg::MuRule>(mu);
  options.accelerate = accelerate;
  options.max_rank = max_rank;
  options.certify = certify;
  options.certificate = certificate_options(certificate_tolerance, certificate_failure_probability,
                                            certificate_seed, certificate_max_flops);
  options.iteration =
      iteration_options(tolerance, max_iterations, time_limit, num_threads, callback, signals);
  options.iteration.stop = value_of<rotavg::StopRule>(stop);
  std::optional<rotavg::Rotations> R;
  if (start) R = to_rotations(*start, "init");
  const rotavg::RobustOptions robust{value_of<rotavg::Loss>(loss),
                                     loss_scale,
                                     cycle_threshold,
                                     min_cycles,
                                     value_of<rotavg::WeightKind>(weight_kind),
                                     {to_mask(trusted), to_mask(excluded), to_doubles(edge_scales),
                                      to_doubles(initial_weights), to_mask(odometry)},
                                     robust_priors};
  const bool plain = robust.loss == rotavg::Loss::l2 && cycle_threshold == 0.0 && !excluded;
  rotavg::RigSolution solution;
  {
    const WithoutGil release;
    rotavg::RobustSolution& reweighted = solution;
    rotavg::Solution& least_squares = solution;
    if (rigs) {
      const auto loss_if_any = plain ? std::nullopt : std::optional(robust);
      solution = rotavg::solve_rigs(graph, *rigs, *rig_priors, options, loss_if_any, std::move(R));
    } else if (plain && !priors) {
      least_squares = rotavg::solve(graph, options, std::move(R));
    } else if (plain) {
      least_squares = rotavg::solve(*priors, options, std::move(R), start_is_solution);
    } else if (!priors) {
      reweighted = rotavg::solve_robust(graph, options, robust, std::move(R));
    } else {
      reweighted = rotavg::solve_robust(*priors, options, robust, std::move(R));
    }
  }
  // What has converged is not lost because its certificate was interrupted.
  const bool interrupted = signals.is_keyboard_interrupt() && rotavg::is_converged(solution.status);
  if (!interrupted) signals.rethrow();
  py::dict result = solution_dict(solution);
  result["interrupted"] = interrupted;
  if (!plain) result["robust"] = robust_dict(solution);
  if (rigs) result["rigs"] = rigs_dict(solution.rigs);
  return result;
}

py::dict refine_anisotropic(const rotavg::MeasurementGraph& graph, const DoubleArray& information,
                            const DoubleArray& rotations, double tolerance, int max_iterations,
                            double time_limit, int num_threads,
                            const std::optional<py::function>& callback, int iterations_before,
                            const rotavg::GroundedGraph* priors, double prior_precision) {
  SignalCheck signals;
  const auto options = iteration_options(tolerance, max_iterations, time_limit, num_threads,
                                         callback, signals, iterations_before);
  const std::vector<rotavg::Matrix3> omega = to_rotations(information, "information");
  rotavg::Rotations R = to_rotations(rotations, "rotations");
  const auto result = without_gil([&] {
    if (priors) return rotavg::refine_anisotropic(*priors, {omega, prior_precision}, R, options);
    return rotavg::refine_anisotropic(graph, omega, std::move(R), options);
  });
  signals.rethrow();
  py::dict dict;
  dict["rotations"] = from_rotations(result.rotations);
  dict["objective"] = result.objective;
  dict["gradient_norm"] = result.gradient_norm;
  dict["relative_gradient"] = result.relative_gradient;
  dict["status"] = name_of(result.status);
  dict["iterations"] = result.iterations;
  dict["trace"] = trace_dict(result.trace);
  dict["seconds"] = result.seconds;
  return dict;
}

py::tuple invalid_option_arguments(const InvalidOption& error) {
  return py::make_tuple(error.what());
}

py::tuple too_large_arguments(const rotavg::TooLarge& error) {
  return py::make_tuple(error.what());
}

}  // namespace

void bind_solve(py::module_& m) {
  register_error<InvalidOption, invalid_option_arguments>(m, "InvalidOption");
  register_error<rotavg::TooLarge, too_large_arguments>(m, "TooLarge");
  using rotavg::Progress;
  py::class_<Progress>(m, "Progress", "One iteration of a solver.")
      .def_readonly("iteration", &Progress::iteration, "Iterations so far; 0 is the initial value.")
      .def_readonly("objective", &Progress::objective, "f(R), equation (3).")
      .def_readonly("gradient_norm", &Progress::gradient_norm, "Norm of the Riemannian gradient.")
      .def_readonly("relative_gradient", &Progress::relative_gradient,
                    "The gradient relative to the graph's scale, in radians.")
      .def_readonly("step", &Progress::step, "The paper's relative step.")
      .def_readonly("seconds", &Progress::seconds, "Seconds since the solver started.")
      .def("__repr__", [](const Progress& p) {
        return py::str(
                   "Progress(iteration={}, objective={:.9g}, gradient_norm={:.3g}, "
                   "step={:.3g}, seconds={:.3g})")
            .format(p.iteration, p.objective, p.gradient_norm, p.step, p.seconds);
      });
  m.def("solve", &solve, py::arg("graph"), py::kw_only(), py::arg("method"), py::arg("init"),
        py::arg("start"), py::arg("seed"), py::arg("mu"), py::arg("accelerate"),
        py::arg("max_rank"), py::arg("stop"), py::arg("tolerance"), py::arg("max_iterations"),
        py::arg("time_limit"), py::arg("num_threads"), py::arg("certify"),
        py::arg("certificate_tolerance"), py::arg("certificate_failure_probability"),
        py::arg("certificate_seed"), py::arg("certificate_max_flops"), py::arg("callback"),
        py::arg("loss"), py::arg("loss_scale"), py::arg("cycle_threshold"), py::arg("min_cycles"),
        py::arg("weight_kind"), py::arg("trusted"), py::arg("excluded"), py::arg("edge_scales"),
        py::arg("initial_weights"), py::arg("odometry"), py::arg("robust_priors"),
        py::arg("priors").none(true), py::arg("start_is_solution"), py::arg("rigs").none(true),
        py::arg("rig_priors").none(true));
  m.def("refine_anisotropic", &refine_anisotropic, py::arg("graph"), py::arg("information"),
        py::arg("rotations"), py::kw_only(), py::arg("tolerance"), py::arg("max_iterations"),
        py::arg("time_limit"), py::arg("num_threads"), py::arg("callback"),
        py::arg("iterations_before"), py::arg("priors").none(true), py::arg("prior_precision"));
}

}  // namespace rotavg_python

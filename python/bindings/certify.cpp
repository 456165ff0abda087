#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include <rotavg/anisotropic/certify.hpp>
#include <rotavg/anisotropic/graph.hpp>
#include <rotavg/anisotropic/with_priors.hpp>
#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/certify_with_priors.hpp>
#include <rotavg/init/random.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/init/warm_start.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/loso.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/solve/stopwatch.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "errors.hpp"
#include "interrupt.hpp"
#include "names.hpp"
#include "options.hpp"

namespace rotavg_python {
namespace {

using rotavg::MeasurementGraph;

rotavg::Rotations node_rotations(const MeasurementGraph& graph, const DoubleArray& array) {
  return rotavg::checked_rotations(graph, to_rotations(array, "rotations"));
}

py::dict certify(const MeasurementGraph& graph, const DoubleArray& rotations, double tolerance,
                 double failure_probability, std::uint64_t seed, double max_flops,
                 double time_limit, int num_threads, const rotavg::GroundedGraph* priors,
                 const std::optional<DoubleArray>& precisions, double prior_precision) {
  const rotavg::Rotations R = to_rotations(rotations, "rotations");
  SignalCheck signals;
  const rotavg::Stopwatch watch;
  auto options = certificate_options(tolerance, failure_probability, seed, max_flops);
  options.num_threads = num_threads;
  options.keep_going = [&, check = signals.keep_going()] {
    return watch.seconds() < time_limit && check();
  };
  std::optional<std::vector<rotavg::Matrix3>> H;
  if (precisions) H = to_rotations(*precisions, "precisions");
  const rotavg::Certificate certificate = without_gil([&] {
    if (H && priors) return rotavg::certify(*priors, {*H, prior_precision}, R, options);
    if (H) return rotavg::certify(rotavg::AnisotropicGraph(graph, *H), R, options);
    return priors ? rotavg::certify(*priors, R, options) : rotavg::certify(graph, R, options);
  });
  signals.rethrow();
  return certificate_dict(certificate);
}

py::array_t<double> gradient(const MeasurementGraph& graph, const DoubleArray& rotations) {
  const rotavg::Rotations R = node_rotations(graph, rotations);
  const auto g = without_gil([&] { return rotavg::gradient(graph, R); });
  py::array_t<double> result({static_cast<py::ssize_t>(g.size()), py::ssize_t{3}});
  auto out = result.mutable_unchecked<2>();
  for (py::ssize_t i = 0; i < out.shape(0); ++i) {
    for (py::ssize_t k = 0; k < 3; ++k) out(i, k) = g[static_cast<std::size_t>(i)](k);
  }
  return result;
}

std::vector<double> residual_angles(const MeasurementGraph& graph, const rotavg::Rotations& R) {
  std::vector<double> angles;
  angles.reserve(graph.edges().size());
  for (const rotavg::Edge& e : graph.edges()) {
    angles.push_back(rotavg::angle_between(R[e.i] * e.i_from_j(), R[e.j]));
  }
  return angles;
}

py::array_t<double> join_pieces(const MeasurementGraph& graph, const DoubleArray& rotations,
                                const IndexArray& piece) {
  rotavg::Rotations R = to_rotations(rotations, "rotations");
  std::vector<rotavg::Index> label(piece.data(), piece.data() + piece.size());
  return from_rotations(
      without_gil([&] { return rotavg::join_pieces(graph, std::move(R), std::move(label)); }));
}

template <rotavg::Matrix3 (*kernel)(const rotavg::Matrix3&)>
py::array_t<double> on_stack(const DoubleArray& matrices) {
  rotavg::Rotations A = to_rotations(matrices, "matrices");
  for (rotavg::Matrix3& A_k : A) A_k = kernel(A_k);
  return from_rotations(A);
}

py::tuple invalid_rotation_arguments(const rotavg::InvalidRotation& error) {
  return py::make_tuple(error.node(), error.reason());
}

}  // namespace

void bind_certify(py::module_& m) {
  register_error<rotavg::InvalidRotation, invalid_rotation_arguments>(m, "InvalidRotation");

  m.def("certify", &certify, py::arg("graph"), py::arg("rotations"), py::kw_only(),
        py::arg("tolerance"), py::arg("failure_probability"), py::arg("seed"), py::arg("max_flops"),
        py::arg("time_limit"), py::arg("num_threads"), py::arg("priors").none(true),
        py::arg("precisions").none(true), py::arg("prior_precision"));
  m.def(
      "objective",
      [](const MeasurementGraph& graph, const DoubleArray& rotations) {
        const rotavg::Rotations R = node_rotations(graph, rotations);
        return without_gil([&] { return rotavg::objective(graph, R); });
      },
      py::arg("graph"), py::arg("rotations"));
  m.def("gradient", &gradient, py::arg("graph"), py::arg("rotations"));
  m.def(
      "residual_angles",
      [](const MeasurementGraph& graph, const DoubleArray& rotations) {
        const rotavg::Rotations R = node_rotations(graph, rotations);
        return from_vector(without_gil([&] { return residual_angles(graph, R); }));
      },
      py::arg("graph"), py::arg("rotations"));
  m.def(
      "shortest_path_init",
      [](const MeasurementGraph& graph) {
        return from_rotations(without_gil([&] { return rotavg::shortest_path_init(graph); }));
      },
      py::arg("graph"));
  m.def(
      "random_init",
      [](const MeasurementGraph& graph, std::uint64_t seed) {
        return from_rotations(rotavg::random_init(graph, seed));
      },
      py::arg("graph"), py::arg("seed"));
  m.def("join_pieces", &join_pieces, py::arg("graph"), py::arg("rotations"), py::arg("piece"));
  m.def("loso", &on_stack<rotavg::loso>, py::arg("matrices"));
  m.def("loso_fast", &on_stack<rotavg::loso_fast>, py::arg("matrices"));
  m.def("nearest_rotation", &on_stack<rotavg::nearest_rotation>, py::arg("matrices"));
}

}  // namespace rotavg_python

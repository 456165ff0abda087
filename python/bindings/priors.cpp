#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/reduction/refined_gravity.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/uncertainty/covariance_with_priors.hpp>

#include "bindings.hpp"
#include "convert.hpp"
#include "covariances.hpp"
#include "errors.hpp"
#include "names.hpp"

namespace rotavg_python {
namespace {

using rotavg::GroundedGraph;
using rotavg::Index;
using rotavg::MeasurementGraph;

using IdArray = py::array_t<rotavg::NodeId, py::array::c_style | py::array::forcecast>;

std::vector<bool> to_mask(const Mask& mask) {
  return std::vector<bool>(mask.data(), mask.data() + mask.size());
}

void check_count(const py::array& array, std::size_t count, const char* name) {
  if (array.ndim() < 1 || static_cast<std::size_t>(array.shape(0)) != count) {
    throw std::invalid_argument(std::string(name) + " must have " + std::to_string(count) +
                                " entries");
  }
}

/// Nodes are known by their rows. Every argument is an array with one entry for each prior.
rotavg::Priors make_priors(const IdArray& fixed, const DoubleArray& fixed_rotations,
                           const IdArray& absolute, const DoubleArray& absolute_rotations,
                           const DoubleArray& absolute_weights, const IdArray& gravity,
                           const DoubleArray& gravity_downs, const DoubleArray& gravity_weights,
                           const IdArray& rigs, const IdArray& rig_frames,
                           const DoubleArray& rig_rotations, const DoubleArray& down) {
  rotavg::Priors priors;
  const auto count = [](const IdArray& nodes) { return static_cast<std::size_t>(nodes.size()); };
  const rotavg::Rotations held = to_rotations(fixed_rotations, "fixed_rotations");
  check_count(fixed_rotations, count(fixed), "fixed_rotations");
  for (std::size_t k = 0; k < held.size(); ++k) priors.fixed.push_back({fixed.data()[k], held[k]});

  const rotavg::Rotations known = to_rotations(absolute_rotations, "absolute_rotations");
  check_count(absolute_rotations, count(absolute), "absolute_rotations");
  check_count(absolute_weights, known.size(), "absolute_weights");
  for (std::size_t k = 0; k < known.size(); ++k) {
    priors.absolute.push_back({absolute.data()[k], known[k], absolute_weights.data()[k]});
  }

  check_count(gravity_downs, count(gravity), "gravity_downs");
  check_count(gravity_weights, count(gravity), "gravity_weights");
  if (gravity_downs.ndim() != 2 || gravity_downs.shape(1) != 3 || down.size() != 3) {
    throw std::invalid_argument("directions must have three entries");
  }
  for (std::size_t k = 0; k < count(gravity); ++k) {
    const rotavg::Vector3 d(gravity_downs.data() + 3 * k);
    priors.gravity.push_back({gravity.data()[k], d, gravity_weights.data()[k]});
  }

  const rotavg::Rotations cameras = to_rotations(rig_rotations, "rig_rotations");
  check_count(rig_rotations, count(rigs), "rig_rotations");
  check_count(rig_frames, cameras.size(), "rig_frames");
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    priors.rigs.push_back({rigs.data()[k], rig_frames.data()[k], cameras[k]});
  }
  priors.down = rotavg::Vector3(down.data());
  return priors;
}

/// The same for the images of rigs.
rotavg::Rigs make_rigs(const IdArray& nodes, const IdArray& frames, const IdArray& sensors,
                       const IdArray& known, const DoubleArray& known_rotations) {
  rotavg::Rigs rigs;
  const auto count = static_cast<std::size_t>(nodes.size());
  check_count(frames, count, "frames");
  check_count(sensors, count, "sensors");
  for (std::size_t k = 0; k < count; ++k) {
    rigs.images.push_back({nodes.data()[k], frames.data()[k], sensors.data()[k]});
  }
  const rotavg::Rotations C = to_rotations(known_rotations, "known_rotations");
  check_count(known, C.size(), "known");
  for (std::size_t k = 0; k < C.size(); ++k) rigs.known.push_back({known.data()[k], C[k]});
  return rigs;
}

rotavg::Rotations node_rotations(const GroundedGraph& problem, const DoubleArray& array) {
  return rotavg::checked_rotations(problem.given(), to_rotations(array, "rotations"));
}

py::object covariances(const GroundedGraph& problem, const DoubleArray& rotations,
                       const std::optional<IndexArray>& pairs, double noise_variance,
                       int num_threads, const std::optional<DoubleArray>& information,
                       double prior_information) {
  const rotavg::Rotations R = node_rotations(problem, rotations);
  std::vector<rotavg::NodePair> wanted;
  if (pairs) wanted = node_pairs(*pairs, problem.given().num_nodes());
  rotavg::CovarianceOptions options;
  options.noise_variance = noise_variance;
  options.num_threads = num_threads;
  if (information) options.information = to_rotations(*information, "information");
  options.prior_information = prior_information;
  return covariances_or_none(options, [&](const rotavg::CovarianceOptions& checked) {
    return pairs ? rotavg::covariances(problem, R, wanted, checked)
                 : rotavg::marginal_covariances(problem, R, checked);
  });
}

template <double (*function)(const GroundedGraph&, const rotavg::Rotations&)>
double number(const GroundedGraph& problem, const DoubleArray& rotations) {
  return function(problem, node_rotations(problem, rotations));
}

template <std::vector<double> (*function)(const GroundedGraph&, const rotavg::Rotations&)>
py::array_t<double> numbers(const GroundedGraph& problem, const DoubleArray& rotations) {
  return from_vector(function(problem, node_rotations(problem, rotations)));
}

/// Directions (n, 3), zero where there are none.
py::array_t<double> refined_gravity(const MeasurementGraph& graph, const DoubleArray& down,
                                    int rounds) {
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  if (down.ndim() != 2 || down.shape(1) != 3) {
    throw std::invalid_argument("directions must have three entries");
  }
  check_count(down, n, "directions");
  std::vector<rotavg::Vector3> directions;
  for (std::size_t i = 0; i < n; ++i) directions.emplace_back(down.data() + 3 * i);
  const auto refined =
      without_gil([&] { return rotavg::refined_gravity(graph, std::move(directions), rounds); });
  py::array_t<double> result({static_cast<py::ssize_t>(n), py::ssize_t{3}});
  for (std::size_t i = 0; i < n; ++i) {
    std::copy(refined[i].data(), refined[i].data() + 3, result.mutable_data() + 3 * i);
  }
  return result;
}

py::tuple invalid_prior_arguments(const rotavg::InvalidPrior& error) {
  return py::make_tuple(name_of(error.kind()), error.node(), error.reason());
}

}  // namespace

void bind_priors(py::module_& m) {
  m.def("refined_gravity", &refined_gravity, py::arg("graph"), py::arg("down"), py::arg("rounds"));
  register_error<rotavg::InvalidPrior, invalid_prior_arguments>(m, "InvalidPrior");
  py::class_<rotavg::Priors>(m, "Priors")
      .def(py::init(&make_priors), py::kw_only(), py::arg("fixed"), py::arg("fixed_rotations"),
           py::arg("absolute"), py::arg("absolute_rotations"), py::arg("absolute_weights"),
           py::arg("gravity"), py::arg("gravity_downs"), py::arg("gravity_weights"),
           py::arg("rigs"), py::arg("rig_frames"), py::arg("rig_rotations"), py::arg("down"));
  py::class_<rotavg::Rigs>(m, "Rigs").def(py::init(&make_rigs), py::kw_only(), py::arg("nodes"),
                                          py::arg("frames"), py::arg("sensors"), py::arg("known"),
                                          py::arg("known_rotations"));
  py::class_<GroundedGraph>(m, "GroundedGraph")
      .def(py::init([](const MeasurementGraph& given, const rotavg::Priors& priors) {
             const WithoutGil release;
             return GroundedGraph(given, priors);
           }),
           py::keep_alive<1, 2>(), py::arg("given"), py::arg("priors"))
      .def(
          "with_weights",
          [](const GroundedGraph& problem, const DoubleArray& weights) {
            GroundedGraph other = problem;
            other.set_weights({weights.data(), weights.data() + weights.size()});
            return other;
          },
          py::keep_alive<0, 1>(), py::arg("weights"))
      .def(
          "with_prior_weights",
          [](const GroundedGraph& problem, const DoubleArray& absolute,
             const DoubleArray& gravity) {
            GroundedGraph other = problem;
            other.set_prior_weights({absolute.data(), absolute.data() + absolute.size()},
                                    {gravity.data(), gravity.data() + gravity.size()});
            return other;
          },
          py::keep_alive<0, 1>(), py::arg("absolute"), py::arg("gravity"))
      .def_property_readonly("kept", [](const GroundedGraph& p) { return from_vector(p.kept()); })
      .def_property_readonly("num_free_headings", &GroundedGraph::num_free_headings)
      .def_property_readonly("num_parts",
                             [](const GroundedGraph& p) {
                               const std::vector<bool> edges(p.given().edges().size(), true);
                               const std::vector<bool> absolute(p.priors().absolute.size(), true);
                               const std::vector<bool> gravity(p.priors().gravity.size(), false);
                               const auto part =
                                   p.parts_of_nodes(p.edges_where(edges, absolute, gravity));
                               return *std::max_element(part.begin(), part.end()) + 1;
                             })
      .def(
          "edges_where",
          [](const GroundedGraph& p, const Mask& measurements, const Mask& absolute,
             const Mask& gravity) {
            check_count(measurements, p.given().edges().size(), "measurements");
            check_count(absolute, p.priors().absolute.size(), "absolute");
            check_count(gravity, p.priors().gravity.size(), "gravity");
            const auto holds =
                p.edges_where(to_mask(measurements), to_mask(absolute), to_mask(gravity));
            Mask result(static_cast<py::ssize_t>(holds.size()));
            std::copy(holds.begin(), holds.end(), result.mutable_data());
            return result;
          },
          py::arg("measurements"), py::arg("absolute"), py::arg("gravity"))
      .def(
          "degrees_of_freedom",
          [](const GroundedGraph& p, const Mask& holds) {
            check_count(holds, p.graph().edges().size(), "holds");
            return rotavg::degrees_of_freedom(p, to_mask(holds));
          },
          py::arg("holds"))
      .def("objective", &number<&rotavg::objective>, py::arg("rotations"))
      .def("edge_costs", &numbers<&rotavg::edge_costs>, py::arg("rotations"))
      .def("prior_costs", &numbers<&rotavg::prior_costs>, py::arg("rotations"))
      .def("log_prior_costs", &numbers<&rotavg::log_prior_costs>, py::arg("rotations"))
      .def(
          "prior_residuals",
          [](const GroundedGraph& problem, const DoubleArray& rotations) {
            const auto found = rotavg::prior_residuals(problem, node_rotations(problem, rotations));
            return py::make_tuple(from_vector(found.absolute), from_vector(found.gravity));
          },
          py::arg("rotations"))
      .def("covariances", &covariances, py::arg("rotations"), py::arg("pairs"), py::kw_only(),
           py::arg("noise_variance"), py::arg("num_threads"), py::arg("information").none(true),
           py::arg("prior_information"));
}

}  // namespace rotavg_python

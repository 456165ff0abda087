#pragma once

// Enumerators <-> the names that Python sees.

#include <stdexcept>
#include <string>
#include <utility>

#include <pybind11/pybind11.h>

#include <rotavg/certify/certificate.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/solve/solve.hpp>

namespace rotavg_python {

namespace py = pybind11;

/// A name that no enumerator has.
class InvalidOption : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

template <typename Enum>
struct Names;

template <>
struct Names<rotavg::Method> {
  static constexpr const char* option = "method";
  static constexpr std::pair<rotavg::Method, const char*> list[] = {
      {rotavg::Method::automatic, "auto"},
      {rotavg::Method::bcd, "bcd"},
      {rotavg::Method::sum, "sum"},
      {rotavg::Method::newton, "newton"},
      {rotavg::Method::staircase, "staircase"},
      {rotavg::Method::bcdsr, "bcdsr"}};
};

template <>
struct Names<rotavg::Initialization> {
  static constexpr const char* option = "init";
  static constexpr std::pair<rotavg::Initialization, const char*> list[] = {
      {rotavg::Initialization::automatic, "auto"},
      {rotavg::Initialization::shortest_path, "shortest_path"},
      {rotavg::Initialization::spanning_tree, "spanning_tree"},
      {rotavg::Initialization::maximum_spanning_tree, "maximum_spanning_tree"},
      {rotavg::Initialization::multilevel, "multilevel"},
      {rotavg::Initialization::chordal, "chordal"},
      {rotavg::Initialization::quaternion, "quaternion"},
      {rotavg::Initialization::random, "random"}};
};

template <>
struct Names<rotavg::MuRule> {
  static constexpr const char* option = "mu";
  static constexpr std::pair<rotavg::MuRule, const char*> list[] = {
      {rotavg::MuRule::adaptive, "adaptive"}, {rotavg::MuRule::min_eigenvalue, "min_eigenvalue"}};
};

template <>
struct Names<rotavg::StopRule> {
  static constexpr const char* option = "stop";
  static constexpr std::pair<rotavg::StopRule, const char*> list[] = {
      {rotavg::StopRule::gradient, "gradient"}, {rotavg::StopRule::step, "step"}};
};

template <>
struct Names<rotavg::Loss> {
  static constexpr const char* option = "loss";
  static constexpr std::pair<rotavg::Loss, const char*> list[] = {
      {rotavg::Loss::l2, "l2"},         {rotavg::Loss::huber, "huber"},
      {rotavg::Loss::l1, "l1"},         {rotavg::Loss::l_half, "l_half"},
      {rotavg::Loss::cauchy, "cauchy"}, {rotavg::Loss::geman_mcclure, "geman_mcclure"},
      {rotavg::Loss::tls, "tls"},       {rotavg::Loss::automatic, "auto"}};
};

template <>
struct Names<rotavg::WeightKind> {
  static constexpr const char* option = "weight_kind";
  static constexpr std::pair<rotavg::WeightKind, const char*> list[] = {
      {rotavg::WeightKind::automatic, "auto"},
      {rotavg::WeightKind::precision, "precision"},
      {rotavg::WeightKind::frequency, "frequency"}};
};

template <>
struct Names<rotavg::EdgeVerdict> {
  static constexpr std::pair<rotavg::EdgeVerdict, const char*> list[] = {
      {rotavg::EdgeVerdict::inlier, "inlier"},
      {rotavg::EdgeVerdict::bridge, "bridge"},
      {rotavg::EdgeVerdict::trusted, "trusted"},
      {rotavg::EdgeVerdict::robust_weight, "robust_weight"},
      {rotavg::EdgeVerdict::cycle_check, "cycle_check"},
      {rotavg::EdgeVerdict::weak_part, "weak_part"},
      {rotavg::EdgeVerdict::excluded, "excluded"}};
};

template <>
struct Names<rotavg::Status> {
  static constexpr std::pair<rotavg::Status, const char*> list[] = {
      {rotavg::Status::not_run, "not_run"},
      {rotavg::Status::gradient_converged, "gradient_converged"},
      {rotavg::Status::step_converged, "step_converged"},
      {rotavg::Status::iteration_limit, "iteration_limit"},
      {rotavg::Status::time_limit, "time_limit"},
      {rotavg::Status::stopped, "stopped"}};
};

template <>
struct Names<rotavg::Verdict> {
  static constexpr std::pair<rotavg::Verdict, const char*> list[] = {
      {rotavg::Verdict::not_run, "not_run"},
      {rotavg::Verdict::proved, "proved"},
      {rotavg::Verdict::estimated, "estimated"},
      {rotavg::Verdict::not_certified, "not_certified"}};
};

template <>
struct Names<rotavg::CertificateMethod> {
  static constexpr std::pair<rotavg::CertificateMethod, const char*> list[] = {
      {rotavg::CertificateMethod::none, "none"},
      {rotavg::CertificateMethod::factorization, "factorization"},
      {rotavg::CertificateMethod::connectivity, "connectivity"},
      {rotavg::CertificateMethod::relaxation, "relaxation"},
      {rotavg::CertificateMethod::random_start, "random_start"},
      {rotavg::CertificateMethod::eigenvalue, "eigenvalue"},
      {rotavg::CertificateMethod::nonnegativity, "nonnegativity"}};
};

template <>
struct Names<rotavg::SensorOrigin> {
  static constexpr std::pair<rotavg::SensorOrigin, const char*> list[] = {
      {rotavg::SensorOrigin::known, "known"},
      {rotavg::SensorOrigin::reference, "reference"},
      {rotavg::SensorOrigin::estimated, "estimated"}};
};

template <>
struct Names<rotavg::PriorKind> {
  static constexpr std::pair<rotavg::PriorKind, const char*> list[] = {
      {rotavg::PriorKind::fixed, "fixed"},     {rotavg::PriorKind::absolute, "absolute"},
      {rotavg::PriorKind::gravity, "gravity"}, {rotavg::PriorKind::rig, "rig"},
      {rotavg::PriorKind::sensor, "sensor"},   {rotavg::PriorKind::down, "down"}};
};

template <>
struct Names<rotavg::Shortfall> {
  static constexpr std::pair<rotavg::Shortfall, const char*> list[] = {
      {rotavg::Shortfall::none, "none"},           {rotavg::Shortfall::leftover, "leftover"},
      {rotavg::Shortfall::negative, "negative"},   {rotavg::Shortfall::relaxation, "relaxation"},
      {rotavg::Shortfall::undecided, "undecided"}, {rotavg::Shortfall::stopped, "stopped"}};
};

template <typename Enum>
const char* name_of(Enum value) {
  for (const auto& [enumerator, name] : Names<Enum>::list) {
    if (enumerator == value) return name;
  }
  throw std::logic_error("an enumerator has no name");
}

/// @throws InvalidOption that lists the names there are
template <typename Enum>
Enum value_of(const std::string& name) {
  std::string known;
  for (const auto& [enumerator, candidate] : Names<Enum>::list) {
    if (candidate == name) return enumerator;
    known += known.empty() ? "" : ", ";
    known += candidate;
  }
  throw InvalidOption(std::string("unknown ") + Names<Enum>::option + " '" + name +
                      "'; expected one of: " + known);
}

inline py::dict certificate_dict(const rotavg::ComponentCertificate& certificate) {
  py::dict result;
  result["verdict"] = name_of(certificate.verdict);
  result["method"] = name_of(certificate.method);
  result["lambda_min"] = certificate.lambda_min;
  result["gap"] = certificate.gap;
  result["relative_gap"] = certificate.relative_gap;
  result["failure_probability"] = certificate.failure_probability;
  result["shortfall"] = name_of(certificate.shortfall);
  return result;
}

inline py::dict certificate_dict(const rotavg::Certificate& certificate) {
  py::dict result = certificate_dict(static_cast<const rotavg::ComponentCertificate&>(certificate));
  py::list components;
  for (const auto& part : certificate.components) components.append(certificate_dict(part));
  result["components"] = components;
  return result;
}

}  // namespace rotavg_python

#pragma once

// What the covariances with and without priors share.

#include <stdexcept>
#include <vector>

#include <rotavg/uncertainty/covariance.hpp>

#include "convert.hpp"
#include "interrupt.hpp"

namespace rotavg_python {

inline std::vector<rotavg::NodePair> node_pairs(const IndexArray& array, rotavg::Index num_nodes) {
  if (array.ndim() != 2 || array.shape(1) != 2) {
    throw std::invalid_argument("pairs must have the shape (k, 2)");
  }
  const auto rows = array.unchecked<2>();
  std::vector<rotavg::NodePair> pairs(static_cast<std::size_t>(array.shape(0)));
  for (py::ssize_t k = 0; k < array.shape(0); ++k) {
    for (py::ssize_t end = 0; end < 2; ++end) {
      if (rows(k, end) < 0 || rows(k, end) >= num_nodes) {
        throw std::out_of_range("there is no such node");
      }
    }
    pairs[static_cast<std::size_t>(k)] = {rows(k, 0), rows(k, 1)};
  }
  return pairs;
}

/// What `compute(options)` returns without the GIL, heeding Ctrl-C: (k, 3, 3), or None where f has
/// no strict minimum.
template <typename Compute>
py::object covariances_or_none(rotavg::CovarianceOptions options, Compute&& compute) {
  SignalCheck signals;
  options.keep_going = signals.keep_going();
  const rotavg::Covariances result = without_gil([&] { return compute(options); });
  signals.rethrow();
  if (result.status != rotavg::CovarianceStatus::computed) return py::none();
  return from_rotations(result.pairs);
}

}  // namespace rotavg_python

#pragma once

#include <vector>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// A local minimum of
///
///     F(R) = sum_E r_ij^T Omega_ij r_ij,     r_ij = log(R_ij^T R_i^T R_j),
///
/// the problem of measurements R_ij = R_i^T R_j exp([e]) with e, in the frame of j, of the
/// covariance Omega_ij^-1: by the method of Gauss and Newton in R_i <- exp(w_i) R_i, w with a line
/// search (Armijo). No certificate is known for it: start at the optimum of (3). (With priors:
/// anisotropic/with_priors.hpp.)
///
/// @param information (m,) Omega of every edge, symmetric and positive definite
/// @throws InvalidEdge for one that is not finite, symmetric and positive semidefinite
/// @throws InvalidRotation, std::invalid_argument unless there is one Omega for each edge and one
///         rotation for each node
ROTAVG_INLINE IterationResult refine_anisotropic(const MeasurementGraph& graph,
                                                 const std::vector<Matrix3>& information,
                                                 Rotations R, const IterationOptions& options = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/solve/anisotropic_impl.hpp>
#endif

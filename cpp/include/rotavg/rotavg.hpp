#pragma once

/// rotavg: absolute rotations from relative ones, with a proof of optimality.
/// Layers, each using only those before it:
///   types -> parallel, so3 -> linalg -> graph -> problem -> reduction -> init, certify -> solve ->
///   robust, uncertainty

// The entry points, and what they take and return.
#include <rotavg/certify/certificate.hpp>
#include <rotavg/certify/certify_with_priors.hpp>
#include <rotavg/graph/algebraic_connectivity.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/problem/check_rotations.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/solve_rigs.hpp>
#include <rotavg/robust/solve_robust.hpp>
#include <rotavg/robust/solve_robust_with_priors.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/solve/anisotropic.hpp>
#include <rotavg/solve/solution.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/solve_with_priors.hpp>
#include <rotavg/uncertainty/covariance.hpp>
#include <rotavg/uncertainty/covariance_with_priors.hpp>
#include <rotavg/version.hpp>

// What they are made of. With rotavg::compiled, include what you use of it.
#ifndef ROTAVG_COMPILED
#include <rotavg/graph/breadth_first.hpp>
#include <rotavg/graph/bridges.hpp>
#include <rotavg/graph/checked_part.hpp>
#include <rotavg/graph/laplacian.hpp>
#include <rotavg/graph/parts.hpp>
#include <rotavg/graph/series.hpp>
#include <rotavg/init/chordal.hpp>
#include <rotavg/init/edge_support.hpp>
#include <rotavg/init/maximum_spanning_tree.hpp>
#include <rotavg/init/quaternion.hpp>
#include <rotavg/init/random.hpp>
#include <rotavg/init/rig_start.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/init/spanning_tree.hpp>
#include <rotavg/init/warm_start.hpp>
#include <rotavg/problem/connection.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/problem/laplacian_metric.hpp>
#include <rotavg/problem/lifted.hpp>
#include <rotavg/reduction/alignment.hpp>
#include <rotavg/reduction/checked_priors.hpp>
#include <rotavg/reduction/gravity.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/reduction/prior_objective.hpp>
#include <rotavg/reduction/reduced_graph.hpp>
#include <rotavg/reduction/refined_gravity.hpp>
#include <rotavg/reduction/riding.hpp>
#include <rotavg/reduction/rigs.hpp>
#include <rotavg/reduction/world.hpp>
#include <rotavg/robust/consensus.hpp>
#include <rotavg/robust/cycles.hpp>
#include <rotavg/robust/default_scale.hpp>
#include <rotavg/robust/edge_knowledge.hpp>
#include <rotavg/robust/gnc.hpp>
#include <rotavg/robust/inner.hpp>
#include <rotavg/robust/irls.hpp>
#include <rotavg/robust/loss.hpp>
#include <rotavg/robust/residuals.hpp>
#include <rotavg/robust/reweighted_sweep.hpp>
#include <rotavg/robust/robust_priors.hpp>
#include <rotavg/robust/run.hpp>
#include <rotavg/robust/scale.hpp>
#include <rotavg/robust/verdicts.hpp>
#include <rotavg/robust/votes.hpp>
#include <rotavg/so3/lanes.hpp>
#include <rotavg/so3/loso.hpp>
#include <rotavg/so3/random.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/so3/svd.hpp>
#include <rotavg/solve/accelerated.hpp>
#include <rotavg/solve/automatic.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/bcdsr.hpp>
#include <rotavg/solve/lifted_newton.hpp>
#include <rotavg/solve/newton.hpp>
#include <rotavg/solve/run.hpp>
#include <rotavg/solve/shared_rotations.hpp>
#include <rotavg/solve/staircase.hpp>
#include <rotavg/solve/sum.hpp>
#endif

"""Whether gravity is far more precise than its weight says."""

from __future__ import annotations

import numpy as np

from rotavg.solving.solved import Solved

# Medians of the length of a normal vector of three and of two components.
_MEDIAN_OF_THREE, _MEDIAN_OF_TWO = 1.538, 1.177
_TIMES = 10.0  # a smaller factor is not worth a sentence
_LEAST_SHARE = 4.0  # a node's edges over its gravity: below, residuals follow the weight
_LEAST_NOISE = 1e-6  # radians


def heavier_gravity(solution: Solved) -> float | None:
    """A factor for the weights of gravity, if what it leaves over asks for far heavier ones.

    Weights are inverse variances; those of edges and of gravity are compared by the medians of
    their residuals. Rotations err, too, so that the factor is rather too small.
    """
    if solution.grounded is None or not solution.grounded.priors.gravity:
        return None
    _, tilts = solution.grounded.core.prior_residuals(solution.rotations)
    weights = np.array([float(w) for _, w in solution.grounded.priors.gravity.values()])
    kept = np.ones(solution.graph.num_edges, bool)
    if solution.robust is not None:
        kept = ~solution.is_outlier
        fit = solution.robust.gravity_priors
        if fit is not None:
            tilts = tilts[~fit.is_outlier]
    if len(tilts) == 0 or not kept.any():
        return None
    graph = solution.graph
    at_node = np.bincount(graph.indices[kept].ravel(), np.repeat(graph.weights[kept], 2))
    gravity = float(np.median(weights))
    if float(np.median(at_node)) < _LEAST_SHARE * gravity:
        return None
    edge = float(np.median(solution.residual_angles[kept])) / _MEDIAN_OF_THREE
    tilt = max(float(np.median(tilts)) / _MEDIAN_OF_TWO, _LEAST_NOISE)
    factor = float(np.median(graph.weights[kept])) / gravity * (edge / tilt) ** 2
    return factor if factor >= _TIMES else None

"""What edges and priors add to the objective of a solution, whichever that is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.graph.covariances import information, precision_of_weight_one

if TYPE_CHECKING:
    from rotavg.solving.solution import Solution


def edge_costs(solution: Solution) -> NDArray[np.float64]:
    """(m,) of every edge, with the final weights."""
    graph, angles = solution.graph, solution.residual_angles
    if not solution.anisotropic:
        # |R_i R_ij - R_j|_F^2 = 8 sin^2(angle / 2)
        return np.asarray(8.0 * solution.edge_weights * np.sin(0.5 * angles) ** 2)
    assert graph.covariances is not None
    omega = information(graph.covariances, solution.edge_weights / graph.weights)
    R, (i, j) = solution.rotations, graph.indices.T
    q = quaternions_from_matrices(np.swapaxes(R[i] @ graph.rotations, 1, 2) @ R[j])
    r = 2 * q[:, :3]  # sin(angle / 2) along the axis, twice
    if solution.anisotropic == "log":
        r /= np.sinc(angles / (2 * np.pi))[:, None]
    return np.asarray(np.einsum("ma,mab,mb->m", r, omega, r))


def prior_costs(solution: Solution) -> NDArray[np.float64]:
    """(n,) of the priors of every node; zero where there are none."""
    graph, grounded = solution.graph, solution.grounded
    if grounded is None:
        return np.zeros(graph.num_nodes)
    costs = grounded.prior_costs(solution.rotations, logarithms=solution.anisotropic == "log")
    if not solution.anisotropic:
        return costs
    # A precision h I is the weight h / 2.
    assert graph.covariances is not None
    return 0.5 * precision_of_weight_one(graph.covariances, graph.weights) * costs

"""The objective (3) and its gradient at any rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.core_call import NodeRotations, call_core, node_rotations


def objective(graph: MeasurementGraph, rotations: NodeRotations) -> float:
    """Objective (3), sum of w |R_i R_ij - R_j|_F^2, at rotations as `certify` takes them.

    Raises GraphError for a matrix that is no rotation, or unless there is one for each node.
    """
    return call_core(graph, _core.objective, node_rotations(graph, rotations, "rotations"))


def gradient(graph: MeasurementGraph, rotations: NodeRotations) -> NDArray[np.float64]:
    """Riemannian gradient (n, 3) of the objective (3) at rotations as `certify` takes them.

    Row i is the derivative along R_i <- exp([w]) R_i with respect to w (radians) at w = 0. Raises
    as `objective` does.
    """
    return call_core(graph, _core.gradient, node_rotations(graph, rotations, "rotations"))

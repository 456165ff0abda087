"""The arrays of a measurement graph as a NetworkX graph with a rotation on every edge, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, require
from rotavg.graph import conventions
from rotavg.graph.ids import IdArray, as_edges, edge_error


def arrays_from_networkx(graph: Any, rotation: str, weight: str) -> dict[str, Any]:
    """What a graph says, as the constructor of MeasurementGraph takes it.

    See `MeasurementGraph.from_networkx`.
    """
    if not graph.is_directed():
        raise GraphError(
            "the networkx graph is undirected, so an edge {u, v} does not say whether its "
            "rotation is u_from_v or v_from_u: expected a DiGraph or a MultiDiGraph"
        )
    edges = as_edges(list(graph.edges()))
    matrices = np.empty((len(edges), 3, 3))
    weights = []
    spread = [attributes.get("covariance") for _, _, attributes in graph.edges(data=True)]
    some = [k for k, covariance in enumerate(spread) if covariance is not None]
    if some and len(some) < len(edges):
        missing = next(k for k, covariance in enumerate(spread) if covariance is None)
        reason = f"it has no attribute 'covariance', which {len(some)} of {len(edges)} have"
        raise edge_error(edges, missing, reason)
    for k, (_, _, attributes) in enumerate(graph.edges(data=True)):
        if rotation not in attributes:
            raise edge_error(edges, k, f"it has no attribute {rotation!r}")
        matrices[k] = _matrix(attributes[rotation], edges, k)
        weights.append(attributes.get(weight, None if some else 1.0))
    return {
        "edges": edges,
        "rotations": matrices,
        "weights": None if None in weights else weights,
        "nodes": list(graph.nodes),
        "covariances": spread if some else None,
    }


def networkx_from_arrays(
    edges: IdArray,
    rotations: NDArray[np.float64],
    weights: NDArray[np.float64],
    nodes: IdArray,
    covariances: NDArray[np.float64] | None,
) -> Any:
    """See `MeasurementGraph.to_networkx`."""
    result = require("networkx", "networkx").MultiDiGraph()
    result.add_nodes_from(nodes.tolist())
    for k, (i, j) in enumerate(edges.tolist()):
        spread = {} if covariances is None else {"covariance": covariances[k].copy()}
        result.add_edge(i, j, rotation=rotations[k].copy(), weight=float(weights[k]), **spread)
    return result


def _matrix(value: Any, edges: IdArray, edge: int) -> NDArray[np.float64]:
    """Rotation matrix of an edge attribute that holds a matrix or a quaternion."""
    if np.shape(value) == (3, 3):
        return as_floats(value, (3, 3), "rotations")
    if np.shape(value) != (4,):
        reason = f"its rotation has shape {np.shape(value)}, expected (3, 3) or (4,)"
        raise edge_error(edges, edge, reason)
    quaternion = as_floats([value], (1, 4), "quaternions")
    bad = conventions.first_bad_quaternion(quaternion)
    if bad is not None:
        raise edge_error(edges, edge, bad[1])
    return conventions.matrices_from_quaternions(quaternion).reshape(3, 3)

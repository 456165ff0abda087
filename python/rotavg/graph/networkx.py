"""The arrays of a measurement graph as a NetworkX graph with a rotation on every edge, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, require
from rotavg.graph import conventions
from rotavg.graph.ids import IdArray, as_edges, edge_error


def arrays_from_networkx(
    graph: Any, rotation: str, weight: str
) -> tuple[IdArray, NDArray[np.float64], list[Any], list[Any]]:
    """Edges, rotations, weights and nodes as the constructor of MeasurementGraph takes them.

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
    for k, (_, _, attributes) in enumerate(graph.edges(data=True)):
        if rotation not in attributes:
            raise edge_error(edges, k, f"it has no attribute {rotation!r}")
        matrices[k] = _matrix(attributes[rotation], edges, k)
        weights.append(attributes.get(weight, 1.0))
    return edges, matrices, weights, list(graph.nodes)


def networkx_from_arrays(
    edges: IdArray,
    rotations: NDArray[np.float64],
    weights: NDArray[np.float64],
    nodes: IdArray,
) -> Any:
    """See `MeasurementGraph.to_networkx`."""
    result = require("networkx", "networkx").MultiDiGraph()
    result.add_nodes_from(nodes.tolist())
    for (i, j), R, w in zip(edges.tolist(), rotations, weights.tolist()):
        result.add_edge(i, j, rotation=R.copy(), weight=w)
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

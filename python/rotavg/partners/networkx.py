"""NetworkX: directed graphs with a rotation on every edge."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg import conventions
from rotavg.arrays import as_floats
from rotavg.conventions import Convention
from rotavg.errors import GraphError, require
from rotavg.graph import MeasurementGraph, edge_error
from rotavg.ids import IdArray, as_edges


def from_networkx(
    graph: Any,
    rotation: str = "rotation",
    weight: str = "weight",
    convention: Convention = "pose",
) -> MeasurementGraph:
    """See `MeasurementGraph.from_networkx`."""
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
    return MeasurementGraph(edges, matrices, weights, list(graph.nodes), convention=convention)


def to_networkx(graph: MeasurementGraph) -> Any:
    """See `MeasurementGraph.to_networkx`."""
    result = require("networkx", "networkx").MultiDiGraph()
    result.add_nodes_from(graph.nodes.tolist())
    for (i, j), R, w in zip(graph.edges.tolist(), graph.rotations, graph.weights.tolist()):
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

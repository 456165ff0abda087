"""The arrays of a measurement graph as a NetworkX graph with a rotation on every edge, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, require
from rotavg.graph import conventions
from rotavg.graph.ids import IdArray, as_edges, edge_error


def arrays_from_networkx(graph: Any, rotation: str, weight: str, covariance: str) -> dict[str, Any]:
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
    spread = _of_all_or_none(graph, covariance, edges)
    for k, (_, _, attributes) in enumerate(graph.edges(data=True)):
        if rotation not in attributes:
            raise edge_error(edges, k, f"it has no attribute {rotation!r}")
        matrices[k] = _matrix(attributes[rotation], edges, k)
        weights.append(attributes.get(weight, 1.0))
    return {
        "edges": edges,
        "rotations": matrices,
        "weights": weights if spread is None else _of_all_or_none(graph, weight, edges),
        "nodes": list(graph.nodes),
        "covariances": None if spread is None else _covariances(spread, edges),
    }


def _of_all_or_none(graph: Any, name: str, edges: IdArray) -> list[Any] | None:
    """An attribute of all edges, if any has it; GraphError for the first that lacks it then."""
    values = [attributes.get(name) for _, _, attributes in graph.edges(data=True)]
    lacking = [k for k, value in enumerate(values) if value is None]
    if len(lacking) == len(edges):
        return None
    if lacking:
        count = len(edges) - len(lacking)
        reason = f"it has no attribute {name!r}, which {count} of {len(edges)} have"
        raise edge_error(edges, lacking[0], reason)
    return values


def _covariances(values: list[Any], edges: IdArray) -> NDArray[np.float64]:
    result = np.empty((len(edges), 3, 3))
    for k, value in enumerate(values):
        if np.shape(value) != (3, 3):
            reason = f"its covariance has shape {np.shape(value)}, expected (3, 3)"
            raise edge_error(edges, k, reason)
        result[k] = as_floats(value, (3, 3), "covariances")
    return result


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

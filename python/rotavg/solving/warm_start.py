"""A start from rotations that are known of some nodes, as the last solution of a changing graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.errors import GraphError, expect
from rotavg.graph.ids import IdArray, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph


def warm_start(
    graph: MeasurementGraph,
    nodes: IdArray,
    rotations: NDArray[np.float64],
    component: NDArray[np.int32] | None = None,
    *,
    what: str = "init",
) -> NDArray[np.float64]:
    """Rotations (n, 3, 3) of all nodes of a graph from those that are known of some.

    What is known is known up to a rotation of each component: these are turned, the largest held,
    to where an edge between two of them fits exactly, the one that most others agree with; nodes
    of which nothing is known are placed likewise (cpp/include/rotavg/init/warm_start.hpp).

    Args:
        graph: the graph to be solved.
        nodes: (k,) ids; what is known of nodes that the graph does not have is skipped.
        rotations: (k, 3, 3) world_from_node.
        component: (k,) labels; by default all are of one.
        what: the name of all this in errors.

    Raises:
        GraphError: if the graph has none of the nodes, or for a matrix that is not a rotation.
    """
    expect(graph, MeasurementGraph)
    row = rows_of(graph.nodes, nodes)
    known = row >= 0
    if not known.any():
        raise GraphError(
            f"{what}: none of its {len(nodes)} nodes is in the graph, expected ids as in the graph "
            f"(say, {graph.nodes[0].item()!r})"
        )
    given = np.tile(np.eye(3), (graph.num_nodes, 1, 1))
    given[known] = rotations[row[known]]
    piece = np.full(graph.num_nodes, -1, dtype=np.int32)
    label = np.zeros(len(nodes), dtype=np.int32) if component is None else component
    piece[known] = np.unique(label[row[known]], return_inverse=True)[1].ravel()
    try:
        return _core.join_pieces(graph._core, given, piece)
    except _core.InvalidRotation as error:
        at, reason = error.args
        raise GraphError(
            f"{what}: the matrix of node {graph.nodes[at].item()!r} {reason}"
        ) from None

"""What no cycle checks: bridges, edges that outliers alone check, groups that hang on either."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.graph.measurement_graph import MeasurementGraph

_FEW_NODES, _FEW_OF_ALL = 3, 0.02  # that are no group; the second as where stories differ


def bridges(graph: MeasurementGraph) -> NDArray[np.bool_]:
    """(m,) whether the graph falls apart without the edge: then no cycle checks what it says."""
    return read_only(_core.bridges(graph._core))


def unchecked_edges(graph: MeasurementGraph, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(m,) edges that are bridges among those `kept` (m,), and were none before."""
    unchecked = np.zeros(graph.num_edges, dtype=np.bool_)
    if kept.any() and not kept.all():
        believed = graph.with_weights(np.where(kept, graph.weights, 0.0))
        unchecked[kept] = bridges(believed)
        unchecked &= ~bridges(graph)
    return read_only(unchecked)


def hanging_groups(
    graph: MeasurementGraph, checks: NDArray[np.bool_], part: NDArray[np.integer[Any]]
) -> list[NDArray[Any]]:
    """Groups of nodes (ids) that the edges `checks` (m,) hold together, but not to the rest.

    In each `part` (n,) the rest is the largest group. The largest of all comes first; those of few
    nodes are left out.
    """
    if not checks.any():
        return []
    group = graph.with_weights(np.where(checks, graph.weights, 0.0)).components()
    size, first = np.bincount(group), np.unique(group, return_index=True)[1]
    order = np.argsort(-size, kind="stable")
    # The largest of every part, which outliers alone join to others, is what the rest hangs on.
    largest = order[np.unique(part[first[order]], return_index=True)[1]]
    least = max(_FEW_NODES, _FEW_OF_ALL * graph.num_nodes)
    hanging = order[(size[order] >= least) & ~np.isin(order, largest)]
    return [read_only(graph.nodes[group == k]) for k in hanging]

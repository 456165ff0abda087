"""Gravity estimated anew from the neighbours of every node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError, OptionError, expect
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph


def refined_gravity(
    graph: MeasurementGraph, gravity: Mapping[Any, ArrayLike], *, rounds: int = 2
) -> dict[Any, NDArray[np.float64]]:
    """Estimate down in the frame of every node from its own direction and its neighbours'.

    What the neighbours j of node i say is R_ij d_j. The direction with the least sum of distances
    to all of these, by weight, is taken: the median, which single wrong directions and wrong edges
    do not move. No absolute rotation is needed. After a robust solution, the graph with its weights
    (`graph.with_weights(solution.edge_weights)`) leaves the wrong edges out beforehand.

    Args:
        graph: the measurements.
        gravity: down (3,) in the frame of a node, of any length, of some of the nodes.
        rounds: how often, each from what the last one found; one reaches one edge far.

    Returns:
        Of every node that has a direction, or a neighbour with one, down as a unit vector (3,).

    Raises:
        GraphError: a node that is not in the graph, or a direction that is zero or not finite.
        OptionError: rounds is no whole number from 1 to 1000.
    """
    expect(graph, MeasurementGraph)
    expect(gravity, Mapping, " of nodes and directions")
    if not (isinstance(rounds, (int, np.integer)) and 1 <= rounds <= 1000):
        raise OptionError(f"rounds is {rounds!r}; expected a whole number from 1 to 1000")
    down = np.zeros((graph.num_nodes, 3))
    keys = [key.item() if isinstance(key, np.generic) else key for key in gravity]
    rows = rows_of(as_ids(keys, "gravity"), graph.nodes) if keys else np.empty(0, dtype=np.int64)
    for row, (node, value) in zip(rows.tolist(), gravity.items()):
        if row < 0:
            raise GraphError(f"the gravity of node {node!r}: it is not in the graph")
        vector = as_floats(value, (3,), f"the entries of the gravity of node {node!r}")
        if not (np.isfinite(vector).all() and vector.any()):
            raise GraphError(f"gravity of node {node!r} is {vector.tolist()}, expected a direction")
        down[row] = vector / np.abs(vector).max()
    refined = _core.refined_gravity(graph._core, down, int(rounds))
    return {
        node: read_only(vector)
        for node, vector in zip(graph.nodes.tolist(), refined)
        if any(vector)
    }

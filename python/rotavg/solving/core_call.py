"""How the core is called for a graph: what it is given, and its errors by the graph's ids."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, OptionError, SolverError, expect
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.online_solution import OnlineSolution
from rotavg.solving.solution import Solution

# Rows as in the nodes of a graph, or a rotation for each of their ids.
NodeRotations = Union[ArrayLike, Solution, OnlineSolution, Mapping[Any, NDArray[np.float64]]]

_Result = TypeVar("_Result")


def call_core(
    graph: MeasurementGraph, function: Callable[..., _Result], *args: Any, **settings: Any
) -> _Result:
    """Call the core for a graph; it refuses matrices that are no rotations, and unknown options."""
    expect(graph, MeasurementGraph)
    try:
        return function(graph._core, *args, **settings)
    except _core.InvalidRotation as error:
        node, reason = error.args
        raise GraphError(f"the matrix of node {graph.nodes[node].item()!r} {reason}") from None
    except _core.InvalidOption as error:
        raise OptionError(str(error)) from None
    except _core.TooLarge as error:
        raise SolverError(str(error)) from None


def node_rotations(
    graph: MeasurementGraph, rotations: NodeRotations, name: str
) -> NDArray[np.float64]:
    """(n, 3, 3) in the order of the graph's nodes; GraphError names what is missing."""
    expect(graph, MeasurementGraph)
    if isinstance(rotations, (Solution, OnlineSolution)):
        ids, given = rotations.nodes, rotations.rotations
    elif isinstance(rotations, Mapping):
        ids = as_ids(list(rotations), f"the ids of {name}")
        given = as_floats(list(rotations.values()), (len(ids), 3, 3), name)
    else:
        return as_floats(rotations, (graph.num_nodes, 3, 3), name)
    rows = rows_of(graph.nodes, ids)
    if (rows < 0).any():
        missing = graph.nodes[np.argmin(rows)].item()
        raise GraphError(f"{name}: there is none of node {missing!r}, expected one of every node")
    return given[rows]

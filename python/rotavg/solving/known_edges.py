"""What is known of edges beforehand: masks, pairs of nodes, numbers, a trajectory's odometry."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, OptionError, expect
from rotavg.graph.ids import IdArray, as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph

_MOST = 0.9  # of the steps from one node to the next, where a graph is a trajectory
_FURTHEST = 10  # ids, where some are missing


def known_edges(
    graph: MeasurementGraph,
    loss: str,
    trusted: ArrayLike | str | None,
    excluded: ArrayLike | None,
    edge_scales: ArrayLike | None,
    initial_weights: ArrayLike | None,
) -> dict[str, Any]:
    """What is known of the edges, as the core takes it; see `solve`.

    Raises GraphError for what does not fit the graph, OptionError for what the loss has no use for.
    """
    expect(graph, MeasurementGraph)
    robust = {"edge_scales": edge_scales, "initial_weights": initial_weights}
    for name, value in robust.items():
        _check_use(name, value, loss)
    left_out = edge_mask(graph, "excluded", excluded)
    trust = trusted_edges(graph, loss, trusted)
    if isinstance(trusted, str) and trust is not None and left_out is not None:
        trust = trust & ~left_out
    if trust is not None and left_out is not None and (trust & left_out).any():
        i, j = graph.edges[np.argmax(trust & left_out)].tolist()
        raise OptionError(f"the edge ({i!r}, {j!r}) is both trusted and excluded")
    likely = next_to_one_another(graph) if loss != "l2" and trusted is None else None
    return {
        "trusted": trust,
        "odometry": likely,
        "excluded": left_out,
        "edge_scales": edge_values(graph, "edge_scales", edge_scales, 1e-50, 1e50),
        "initial_weights": edge_values(graph, "initial_weights", initial_weights, 0.0, 1.0),
    }


def trusted_edges(
    graph: MeasurementGraph, loss: str, trusted: ArrayLike | str | None
) -> NDArray[np.bool_] | None:
    """(m,) mask of them: "odometry", a mask, or pairs of node ids (k, 2); None for None.

    Raises GraphError for what does not fit the graph, OptionError without a robust loss.
    """
    _check_use("trusted", trusted, loss)
    if not isinstance(trusted, str):
        return edge_mask(graph, "trusted", trusted)
    if trusted != "odometry":
        raise OptionError(f'trusted is {trusted!r}; expected "odometry", a mask or pairs of nodes')
    return odometry(graph)


def _check_use(name: str, value: object, loss: str) -> None:
    if value is not None and loss == "l2":
        raise OptionError(f'{name} is for a robust loss, and this is "l2"')


def edge_mask(
    graph: MeasurementGraph, name: str, edges: ArrayLike | None
) -> NDArray[np.bool_] | None:
    """(m,) mask of `edges`, which is one, or pairs of node ids (k, 2); None for None.

    A pair stands for all edges between its nodes, whichever end is first.

    Raises GraphError for a mask of another size, and for nodes that no edge of the graph joins.
    """
    if edges is None:
        return None
    given = np.asarray(edges)
    if given.dtype == np.bool_:
        if given.shape != (graph.num_edges,):
            raise GraphError(
                f"{name} has shape {given.shape}; expected ({graph.num_edges},), one for each "
                "edge, or pairs of nodes (k, 2)"
            )
        return np.ascontiguousarray(given)  # as the core reads it
    if given.size == 0:
        return np.zeros(graph.num_edges, dtype=np.bool_)
    pairs = as_ids(edges, name)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise GraphError(
            f"{name} has shape {pairs.shape}; expected pairs of nodes (k, 2), or a mask "
            f"({graph.num_edges},)"
        )
    rows = np.sort(rows_of(pairs, graph.nodes), axis=1)
    ends = np.sort(graph.indices, axis=1).astype(np.int64)
    n = graph.num_nodes
    wanted, there = rows[:, 0] * n + rows[:, 1], ends[:, 0] * n + ends[:, 1]
    known = (rows >= 0).all(axis=1) & np.isin(wanted, there)
    if not known.all():
        row = int(np.argmin(known))
        i, j = pairs[row].tolist()
        found = f"{name} holds the edge ({i!r}, {j!r}), which the graph does not have"
        raise GraphError(found, edge=row)
    return np.isin(there, wanted)


def odometry(graph: MeasurementGraph) -> NDArray[np.bool_]:
    """(m,) whether an edge joins nodes whose ids follow one another, as those of a trajectory do.

    Raises GraphError if there is none.
    """
    if graph.nodes.dtype.kind == "U":
        raise GraphError("the nodes have names, and so no edge joins consecutive numbers")
    mask = is_step(graph)
    if not mask.any():
        raise GraphError(
            "no edge joins consecutive numbers; name the edges of odometry (trusted=, --trusted)"
        )
    return mask


def is_trajectory(graph: MeasurementGraph) -> bool:
    """Whether nearly every node is joined to that of the next number, as a robot's poses are."""
    if graph.nodes.dtype.kind == "U" or graph.num_nodes < 3:
        return False
    return _are_most(graph.edges[is_step(graph)], graph)


def next_to_one_another(graph: MeasurementGraph) -> NDArray[np.bool_] | None:
    """(m,) whether an edge joins a node to that of the next id that occurs, ten further at most.

    None unless the nodes of nearly all ids are joined so.
    """
    if graph.nodes.dtype.kind == "U" or graph.num_nodes < 3:
        return None
    ids = np.sort(graph.nodes)
    low, high = np.min(graph.edges, axis=1), np.max(graph.edges, axis=1)
    rank = np.searchsorted(ids, low)
    after = ids[np.minimum(rank + 1, len(ids) - 1)]
    mask = (high == after) & (high - low > 0) & (high - low <= _FURTHEST)
    return np.asarray(mask, dtype=np.bool_) if _are_most(graph.edges[mask], graph) else None


def _are_most(steps: IdArray, graph: MeasurementGraph) -> bool:
    return len(np.unique(np.sort(steps, axis=1), axis=0)) >= _MOST * (graph.num_nodes - 1)


def is_step(graph: MeasurementGraph) -> NDArray[np.bool_]:
    """(m,) the same of ids that are numbers, if there are any."""
    ends = graph.edges
    low, high = np.min(ends, axis=1), np.max(ends, axis=1)
    return np.asarray(high - low == 1, dtype=np.bool_)


def edge_values(
    graph: MeasurementGraph, name: str, values: ArrayLike | None, low: float, high: float
) -> NDArray[np.float64] | None:
    """(m,) numbers from `low` to `high`, one for each edge; None for None."""
    if values is None:
        return None
    numbers = as_floats(values, (graph.num_edges,), name)
    within = (numbers >= low) & (numbers <= high)
    if not within.all():
        k = int(np.argmin(within))
        i, j = graph.edges[k].tolist()
        raise OptionError(
            f"{name} of the edge ({i!r}, {j!r}) is {numbers[k]:g}; expected a number from "
            f"{low:g} to {high:g}"
        )
    return numbers

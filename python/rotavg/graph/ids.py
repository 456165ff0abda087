"""Node ids: 64-bit integers or names, never both in one graph, and never through a float."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import GraphError

IdArray = NDArray[Any]  # int64; uint64 where an id needs it; or fixed-width str

_FLOAT_HOLDS_INTEGERS_TO = 2.0**53


def as_ids(values: ArrayLike, what: str, *, copy: bool = True) -> IdArray:
    """Copy of `values` as an array of node ids of one kind; `what` names it in errors.

    Without `copy`, an array that is in order is handed on as it is.

    Raises GraphError for anything else than integers of 64 bits or names, and for a mixture.
    """
    if not copy and isinstance(values, np.ndarray) and values.dtype == np.int64:
        return values
    try:
        ids = np.array(values)
        # Left alone, numpy makes floats of large integers and strings of a mixture.
        if not isinstance(values, np.ndarray) and ids.dtype.kind not in "iu":
            ids = np.array(values, dtype=object)
    except (ValueError, TypeError) as error:  # ragged lists
        raise GraphError(f"{what} are not an array of node ids: {error}") from error
    if ids.dtype.kind == "O":
        return _from_objects(ids, what)
    if ids.dtype.kind == "f":
        return _from_floats(ids, what)
    if ids.dtype.kind == "u":
        fits = ids.size == 0 or ids.max() <= np.iinfo(np.int64).max
        return ids.astype(np.int64 if fits else np.uint64)
    if ids.dtype.kind == "i":
        return ids.astype(np.int64, copy=False)
    if ids.dtype.kind == "U":
        return ids
    raise GraphError(f"{what} have dtype {ids.dtype}, expected integers or names (str)")


def rows_of(ids: IdArray, nodes: IdArray) -> NDArray[np.int64]:
    """Row in `nodes` of every id, -1 where there is none; same shape as `ids`."""
    if len(nodes) == 0:
        return np.full(ids.shape, -1, dtype=np.int64)
    if nodes.dtype.kind == "U" or ids.dtype.kind == "U":
        row = {node: k for k, node in enumerate(nodes.tolist())}
        found = [row.get(node, -1) for node in ids.ravel().tolist()]
        return np.array(found, dtype=np.int64).reshape(ids.shape)
    if nodes.dtype != ids.dtype:  # int64 against uint64 would be compared as floats
        return rows_of(ids.astype(object).astype(str), nodes.astype(object).astype(str))
    span = _span(nodes)
    if span is not None:
        return _rows_in_span(ids, nodes, *span)
    order = np.argsort(nodes, kind="stable")
    in_order = nodes[order]
    place = np.minimum(np.searchsorted(in_order, ids), len(nodes) - 1)
    return np.where(in_order[place] == ids, order[place], -1)


def _rows_in_span(ids: IdArray, nodes: IdArray, low: int, size: int) -> NDArray[np.int64]:
    """`rows_of` for nodes of which most from `low` on are there."""
    rows: NDArray[np.int64] = ids - low
    outside = rows.view(np.uint64) >= size
    missing = bool(outside.any())
    if missing:
        rows[outside] = 0
    if len(nodes) < size or (np.diff(nodes) != 1).any():
        table = np.full(size, -1, dtype=np.int64)
        table[nodes - low] = np.arange(len(nodes))
        rows = table[rows]
    if missing:
        rows[outside] = -1
    return rows


def unique_ids(ids: IdArray) -> IdArray:
    """The distinct ids in ascending order, shape (n,)."""
    if ids.dtype.kind == "U":  # hashing beats sorting long strings
        return np.array(sorted(set(ids.ravel().tolist())))
    span = _span(ids)
    if span is None:
        return np.unique(ids)
    low, size = span
    there = np.zeros(size, dtype=np.bool_)
    there[ids - low] = True
    return np.flatnonzero(there) + low


def _span(ids: IdArray) -> tuple[int, int] | None:
    """The least id, and how many there are up to the largest; None if most of those are not there.

    A table of all of them then takes less time than sorting or searching.
    """
    if ids.dtype != np.int64 or ids.size == 0:
        return None
    low, high = int(ids.min()), int(ids.max())
    size = high - low + 1
    return (low, size) if size <= 4 * ids.size + 1024 else None


def _from_objects(ids: NDArray[Any], what: str) -> IdArray:
    flat = ids.ravel().tolist()
    kinds = {type(value) for value in flat}
    if all(issubclass(kind, str) for kind in kinds):
        return ids.astype(np.str_)
    if all(issubclass(kind, (int, np.integer)) and kind is not bool for kind in kinds):
        low, high = int(min(flat)), int(max(flat))
        for dtype in (np.int64, np.uint64):
            if np.iinfo(dtype).min <= low and high <= np.iinfo(dtype).max:
                return ids.astype(dtype)
        raise GraphError(f"{what} run from {low} to {high}, expected integers of 64 bits")
    if all(issubclass(kind, (float, int, np.number)) and kind is not bool for kind in kinds):
        return _from_floats(ids.astype(np.float64), what)
    names = ", ".join(sorted(kind.__name__ for kind in kinds))
    raise GraphError(f"{what} hold values of type {names}, expected all integers or all str")


def _from_floats(ids: NDArray[Any], what: str) -> IdArray:
    exact = (np.floor(ids) == ids) & (np.abs(ids) <= _FLOAT_HOLDS_INTEGERS_TO)
    if not exact.all():
        found = ids[~exact].flat[0].item()
        raise GraphError(f"{what} hold {found!r}, expected an integer (or a name)")
    return ids.astype(np.int64)


def as_edges(values: ArrayLike) -> IdArray:
    """Edges (m, 2) of node ids, m > 0, that are not to be changed; GraphError otherwise."""
    edges = as_ids(values, "edges", copy=False)
    if edges.size == 0:
        raise GraphError("the graph has no edges, expected at least one")
    if edges.ndim != 2 or edges.shape[1] != 2:
        raise GraphError(f"edges have shape {edges.shape}, expected (m, 2)")
    return edges


def as_nodes(values: ArrayLike) -> IdArray:
    """Copy of `values` as distinct node ids (n,); GraphError otherwise."""
    nodes = as_ids(values, "nodes")
    if nodes.ndim != 1:
        raise GraphError(f"nodes have shape {nodes.shape}, expected (n,)")
    distinct, count = np.unique(nodes, return_counts=True)
    if len(distinct) < len(nodes):
        repeated = distinct[count > 1][0].item()
        raise GraphError(f"node {repeated!r} is listed more than once")
    return nodes


def edge_error(edges: IdArray, edge: int, reason: str) -> GraphError:
    """A GraphError that names row `edge` of the edges (m, 2), and its nodes."""
    i, j = edges[edge].tolist()
    return GraphError(f"edge {edge} ({i!r} -> {j!r}): {reason}", edge=edge)

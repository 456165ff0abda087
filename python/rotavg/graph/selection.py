"""Which nodes and edges make a part of a graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import GraphError
from rotavg.graph.ids import IdArray, as_nodes, rows_of


def in_largest(label: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(n,) the nodes of the component with the most (the first of equals), by their labels (n,)."""
    return np.asarray(label == np.argmax(np.bincount(label)))


def in_large(label: NDArray[np.int32], min_nodes: int) -> NDArray[np.bool_]:
    """(n,) the nodes of the components with at least so many; GraphError if none is."""
    size = np.bincount(label)
    kept = (size >= min_nodes)[label]
    if not kept.any():
        found = f"the largest component has {size.max()} nodes"
        raise GraphError(f"{found}, expected one of {min_nodes} at least")
    return np.asarray(kept)


def among(
    chosen: ArrayLike, nodes: IdArray, indices: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Rows (k,) of the chosen nodes, in their order, and the mask (m,) of edges between them.

    Raises GraphError for an unknown or repeated node, and where there is no edge.
    """
    kept = as_nodes(chosen)
    rows = rows_of(kept, nodes)
    if (rows < 0).any():
        raise GraphError(f"node {kept[np.argmin(rows)].item()!r} is not in the graph")
    is_chosen = np.zeros(len(nodes), dtype=np.bool_)
    is_chosen[rows] = True
    edges = is_chosen[indices[:, 0]] & is_chosen[indices[:, 1]]
    if not edges.any():
        raise GraphError(f"no edge joins two of the {len(kept)} nodes of the subgraph")
    return rows, edges


def marked(edges: ArrayLike, num_edges: int) -> NDArray[np.bool_]:
    """Which edges (m,) are marked True; GraphError for anything but booleans."""
    mask = np.asarray(edges)
    if mask.dtype != np.bool_ or mask.shape != (num_edges,):
        found = f"edges has shape {mask.shape} and type {mask.dtype}"
        raise GraphError(f"{found}, expected booleans ({num_edges},)")
    return mask

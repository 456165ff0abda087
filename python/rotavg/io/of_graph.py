"""What a file says of its nodes, as a dict of those that a graph has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.ids import IdArray, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph


def of_graph(
    path: Path, ids: IdArray, values: NDArray[Any], graph: MeasurementGraph
) -> tuple[dict[Any, Any], str]:
    """The values (k, ...) of the nodes (k,) that the graph has, and how many it has not: "" if all.

    FormatError where the graph has none of them, or the file says nothing, or of a node twice.
    """
    if len(ids) == 0:
        found = "the file says nothing of nodes (of a database: its table pose_priors is empty)"
        raise FormatError(f"{found}, expected what is known of them", path=path)
    rows = rows_of(ids, graph.nodes)
    here = rows >= 0
    if not here.any():
        node = graph.nodes[0].item()
        found = "none of the nodes in the file is in the graph"
        raise FormatError(f"{found}, expected ids as in the graph (say, {node!r})", path=path)
    nodes = graph.nodes[rows[here]].tolist()
    if len(set(nodes)) < len(nodes):
        raise FormatError("the file names a node more than once", path=path)
    missing = len(ids) - len(nodes)
    note = f"{path}: {missing} of {len(ids)} nodes are not in the graph" if missing else ""
    return dict(zip(nodes, values[here])), note


def ids_like(graph: MeasurementGraph, names: Sequence[str]) -> IdArray:
    """Names as ids of the kind that the graph has; what is no integer is not among integers."""
    if graph.nodes.dtype.kind == "U":
        return np.array(names, dtype=np.str_)
    known = {str(node): node for node in graph.nodes.tolist()}
    absent = int(graph.nodes.max()) + 1
    return np.array([known.get(name, absent) for name in names], dtype=np.int64)

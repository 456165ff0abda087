"""Edges that are given but not used: what to tell of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError
from rotavg.graph.ids import IdArray


def not_used(
    edges: IdArray, weights: NDArray[np.float64], used: NDArray[np.bool_]
) -> tuple[str, ...]:
    """What to tell of the edges that are left out; GraphError if none is left."""
    zero = weights == 0
    if not used.any():
        why = "has weight 0" if zero.all() else "has weight 0 or joins a node to itself"
        raise GraphError(f"every edge {why}, expected at least one to use")
    told = []
    for chosen, what in ((zero, "of weight 0"), (~used & ~zero, "from a node to itself")):
        count = int(np.count_nonzero(chosen))
        if count:
            i, j = edges[int(np.argmax(chosen))].tolist()
            plural, verb = ("s", "are") if count > 1 else ("", "is")
            first = "the first" if count > 1 else "it"
            told.append(f"{count} edge{plural} {what} {verb} not used ({first}: {i!r} -> {j!r})")
    return tuple(told)

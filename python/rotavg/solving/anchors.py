"""The gauge of a pose graph some of whose poses are known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.graph.measurement_graph import MeasurementGraph

Floats = NDArray[np.float64]


def in_gauge_of(
    graph: MeasurementGraph,
    rotations: Floats,
    rows: NDArray[np.int64],
    given: Floats,
    fixed: NDArray[np.bool_],
) -> tuple[Floats, set[int]]:
    """The rotations turned, component by component, so that they fit some given ones best.

    Args:
        graph: of n nodes.
        rotations: (n, 3, 3) world_from_node.
        rows: (k,) nodes whose rotation in the other gauge is known.
        given: (k, 3, 3) these rotations.
        fixed: (k,) which of these must stay. A component that has none of these is anchored at its
            first node, if that is among the known ones; otherwise it is not turned.

    Returns:
        (n, 3, 3), where the anchors have exactly the rotations given, and the rows of the anchors.
    """
    label = graph.components()
    first = np.zeros(graph.num_nodes, dtype=np.bool_)
    first[np.unique(label, return_index=True)[1]] = True
    held = np.zeros(label.max() + 1, dtype=np.bool_)
    held[label[rows[fixed]]] = True
    anchor = np.where(held[label[rows]], fixed, first[rows])
    rows, given = rows[anchor], given[anchor]

    # Of several anchors: the chordal mean of what each asks for.
    asked = np.zeros((len(held), 3, 3))
    np.add.at(asked, label[rows], given @ np.swapaxes(rotations[rows], 1, 2))
    asked[~np.isin(np.arange(len(held)), label[rows])] = np.eye(3)
    turned = _core.nearest_rotation(asked)[label] @ rotations
    turned[rows] = given
    return turned, set(rows.tolist())


def moved_to(
    graph: MeasurementGraph, where: Floats, known: Mapping[int, tuple[Floats, Floats]]
) -> Floats:
    """Positions moved, component by component, so that they fit some known ones best.

    Args:
        graph: of n nodes.
        where: (n, 3).
        known: position (3,) of some rows, and the information (3, 3) about it.
    """
    label = graph.components()
    result = np.array(where)
    parts = label[list(known)] if known else np.empty(0, dtype=np.int32)
    for part in np.unique(parts).tolist():
        here = [(row, *known[row]) for row in known if label[row] == part]
        total = sum(omega for _, _, omega in here)
        pull = sum(omega @ (place - where[row]) for row, place, omega in here)
        result[label == part] += np.linalg.lstsq(total, pull, rcond=None)[0]
    return result

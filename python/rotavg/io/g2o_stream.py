"""Edges of a pose graph, line by line, as they come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import first_bad_quaternion, matrices_from_quaternions
from rotavg.graph.ids import IdArray, as_ids
from rotavg.io.dialects import DIALECTS, G2O_3D
from rotavg.io.g2o import information_weights
from rotavg.io.g2o_lines import Lines, edge_table
from rotavg.io.lines import BYTE_ORDER_MARK

_EDGES = {dialect.edge: dialect for dialect in DIALECTS}


class EdgeLine(NamedTuple):
    """One edge: its line, counted from 1; ids (1, 2), i_from_j (1, 3, 3) and weight (1,)."""

    line: int
    ids: IdArray
    rotations: NDArray[np.float64]
    weights: NDArray[np.float64]


def edge_lines(path: Path, lines: Iterable[bytes], unit_weights: bool) -> Iterator[EdgeLine]:
    """The edges of g2o's and TORO's lines; others are skipped, as are comments.

    Args:
        path: for errors.
        lines: as they come.
        unit_weights: whether all weights are 1, whatever the information says; where there is none,
            they are.

    Raises:
        FormatError: a line of an edge breaks the rules of its format; path and line are named.
    """
    for number, text in enumerate(lines, start=1):
        if number == 1:
            text = text.removeprefix(BYTE_ORDER_MARK)
        fields = text.split(None, 3)
        if not fields or fields[0] not in _EDGES:
            continue
        dialect = _EDGES[fields[0]]
        edges = Lines()
        edges.add(path, number, fields, num_ids=2)
        has_information = len(edges.rows[0].split()) > dialect.num_pose
        table = edge_table(path, dialect, edges, unit_weights or not has_information)
        turns = table[:, dialect.dimension : dialect.num_pose]
        if dialect is G2O_3D:
            bad = first_bad_quaternion(turns)
            if bad is not None:
                raise FormatError(bad[1], path=path, line=number)
            rotations = matrices_from_quaternions(turns)
        else:
            rotations = dialect.rotations(turns)
        weights = np.ones(1)
        if has_information and not unit_weights:
            omega = dialect.rotation_information(table[:, dialect.num_pose :])
            weights = information_weights(path, omega, [number])
        yield EdgeLine(number, as_ids(edges.id_array(), "ids").reshape(1, 2), rotations, weights)

"""Gravity as cameras measured it, from GLOMAP's text or COLMAP's database.

    NAME gx gy gz

The vector is the world's direction of gravity, by COLMAP's default (0, 1, 0), in the frame of the
camera: camera_from_world * (0, 1, 0).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import FormatError, IncompleteWarning, expect
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import atomic, registry
from rotavg.io.colmap_database import COLMAP_DATABASE
from rotavg.io.colmap_priors import read_gravity_of
from rotavg.io.lines import check_finite, content_lines, exactly, number_table, plain_name
from rotavg.io.of_graph import ids_like, of_graph


@overload
def read_gravity(path: str | os.PathLike[str]) -> tuple[list[str], NDArray[np.float64]]: ...
@overload
def read_gravity(
    path: str | os.PathLike[str], graph: MeasurementGraph, *, weight: float | None = None
) -> dict[Any, tuple[NDArray[np.float64], float]]: ...
def read_gravity(
    path: str | os.PathLike[str],
    graph: MeasurementGraph | None = None,
    *,
    weight: float | None = None,
) -> Any:
    """Read the direction of gravity in the frame of every image.

    Args:
        path: a text as GLOMAP reads it, or a COLMAP database, whose `pose_priors` are taken.
        graph: the measurements; what the file says of other nodes is left out.
        weight: of gravity at each node; None for the median weight of the graph's edges.

    Returns:
        With a graph, (direction (3,), weight) of its nodes, which is what `Priors` takes:
        `Priors(gravity=read_gravity(path, graph))`. Without one, names of images and the directions
        (k, 3).

    Warns:
        IncompleteWarning: the file has nodes that the graph has not.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds something else, or nothing of the graph's nodes; the message names
            the line.
    """
    path = Path(path)
    names, vectors = _read(path)
    if graph is None:
        return names, vectors
    expect(graph, MeasurementGraph)
    downs, note = of_graph(path, ids_like(graph, names), vectors, graph)
    if note:
        warnings.warn(note, IncompleteWarning, stacklevel=2)
    weight = float(np.median(graph.weights)) if weight is None else float(weight)
    return {node: (down, weight) for node, down in downs.items()}


def _read(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """Names, and directions (k, 3)."""
    data = registry.read_bytes((COLMAP_DATABASE,), path, "directions of gravity")
    if COLMAP_DATABASE.recognises(data):
        return read_gravity_of(path)
    names: list[str] = []
    rows: list[bytes] = []
    lines: list[int] = []
    for line, text in content_lines(path, data):
        fields = text.split(None, 1)
        if len(fields) < 2:
            raise FormatError("found 1 field, expected NAME gx gy gz", path=path, line=line)
        names.append(fields[0].decode(errors="replace"))
        rows.append(fields[1])
        lines.append(line)
    if not lines:
        raise FormatError("the file has no directions, expected NAME gx gy gz", path=path)
    vectors = number_table(path, rows, lines, 3)
    check_finite(path, vectors, lines, ("gx", "gy", "gz"))
    zero = ~vectors.any(axis=1)
    if zero.any():
        row = int(np.argmax(zero))
        found = f"the gravity of {names[row]!r} is zero, expected a direction"
        raise FormatError(found, path=path, line=lines[row])
    return names, vectors


def write_gravity(path: str | os.PathLike[str], names: Sequence[str], vectors: ArrayLike) -> None:
    """Write directions of gravity (k, 3), each in the frame of its camera, as GLOMAP reads them."""
    path = Path(path)
    rows = as_floats(vectors, (len(names), 3), "gravity")
    lines = [" ".join([plain_name(path, str(n)), *exactly(row)]) for n, row in zip(names, rows)]
    atomic.write_files({path: "\n".join([*lines, ""]).encode()})

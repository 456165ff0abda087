"""Gravity as cameras measured it, from GLOMAP's text or COLMAP's database.

    NAME gx gy gz

The vector is the world's direction of gravity, by COLMAP's default (0, 1, 0), in the frame of the
camera: camera_from_world * (0, 1, 0).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import FormatError
from rotavg.io import atomic, registry
from rotavg.io.colmap_database import COLMAP_DATABASE
from rotavg.io.colmap_priors import read_gravity_of
from rotavg.io.lines import check_finite, content_lines, exactly, number_table, plain_name


def read_gravity(path: str | os.PathLike[str]) -> tuple[list[str], NDArray[np.float64]]:
    """Read names of images, and the direction of gravity (k, 3) in the frame of each.

    Args:
        path: a text as GLOMAP reads it, or a COLMAP database, whose `pose_priors` are taken.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds something else; the message names the line.
    """
    path = Path(path)
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

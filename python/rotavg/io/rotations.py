"""Absolute rotations from files: solutions and references, world_from_node (pose family).

id qx qy qz qw           text or CSV, as a solution is written
nodes, rotations         npz, as a solution is written
VERTEX_SE3:QUAT          g2o
"""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.arrays import as_floats
from rotavg.conventions import first_bad_quaternion, matrices_from_quaternions
from rotavg.errors import FormatError, GraphError
from rotavg.ids import IdArray, as_nodes
from rotavg.io.formats import FORMATS
from rotavg.io.lines import check_finite, content_lines, is_number, number_table
from rotavg.io.registry import read_bytes
from rotavg.io.text import SOLUTION_HEADER

_VERTEX = b"VERTEX_SE3:QUAT"
_EXPECTED = "expected rotations: id qx qy qz qw"


def read_rotations(path: str | os.PathLike[str]) -> tuple[IdArray, NDArray[np.float64]]:
    """Read absolute rotations.

    Args:
        path: a text or CSV file of `id qx qy qz qw`, an npz archive of a solution, or a g2o file
            with vertices; told by the content.

    Returns:
        The ids (n,) and the rotations (n, 3, 3) world_from_node.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds no rotations; the message names the line and the reason.
    """
    path = Path(path)
    data = read_bytes(FORMATS, path)
    if data.startswith(b"PK\x03\x04"):
        return _from_npz(path, data)
    vertices = _VERTEX in data
    ids: list[bytes] = []
    rows: list[bytes] = []
    lines: list[int] = []
    for line, text in content_lines(path, data if vertices else data.replace(b",", b" ")):
        fields = text.split()
        if vertices:
            if fields[0] != _VERTEX:
                continue
            fields = [*fields[1:2], *fields[5:]]
        elif not lines and [f.decode(errors="replace").lower() for f in fields] == SOLUTION_HEADER:
            continue
        if len(fields) != 5 or not any(map(is_number, fields[1:])):
            raise FormatError(f"found {len(fields)} fields, {_EXPECTED}", path=path, line=line)
        ids.append(fields[0])
        rows.append(b" ".join(fields[1:]))
        lines.append(line)
    if not lines:
        raise FormatError(f"the file has no rotations, {_EXPECTED}", path=path)
    table = number_table(path, rows, lines, 4)
    check_finite(path, table, lines)
    bad = first_bad_quaternion(table)
    if bad is not None:
        raise FormatError(bad[1], path=path, line=lines[bad[0]])
    return _nodes(path, [field.decode(errors="replace") for field in ids]), (
        matrices_from_quaternions(table)
    )


def _nodes(path: Path, names: list[str]) -> IdArray:
    try:
        integers = list(map(int, names))
        return _checked(path, integers if list(map(str, integers)) == names else names)
    except ValueError as error:
        if isinstance(error, FormatError):
            raise
        return _checked(path, names)


def _checked(path: Path, ids: list[int] | list[str] | IdArray) -> IdArray:
    try:
        return as_nodes(ids)
    except GraphError as error:
        raise FormatError(str(error), path=path) from None


def _from_npz(path: Path, data: bytes) -> tuple[IdArray, NDArray[np.float64]]:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            found = ", ".join(archive.files) or "none"
            if not {"nodes", "rotations"} <= set(archive.files):
                expected = "expected nodes (n,) and rotations (n, 3, 3)"
                raise FormatError(f"found the arrays {found}, {expected}", path=path)
            nodes, rotations = archive["nodes"], archive["rotations"]
    except (OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"found no readable npz archive: {error}", path=path) from error
    ids = _checked(path, nodes)
    try:
        rotations = as_floats(rotations, (len(ids), 3, 3), "rotations")
    except GraphError as error:
        raise FormatError(f"{error}, one for each node", path=path) from None
    return ids, rotations

"""Absolute rotations from files: solutions and references, world_from_node (pose family).

id qx qy qz qw           text or CSV, as a solution is written
nodes, rotations         npz, as a solution is written
VERTEX...                g2o and TORO, see `dialects`
NAME qw qx qy qz         GLOMAP, camera_from_world (vision family)
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
from rotavg.conventions import (
    Convention,
    convert_family,
    first_bad_quaternion,
    matrices_from_quaternions,
    xyzw_from_wxyz,
)
from rotavg.errors import FormatError, GraphError
from rotavg.ids import IdArray, as_nodes
from rotavg.io.dialects import DIALECTS
from rotavg.io.formats import FORMATS
from rotavg.io.g2o import G2O, TORO
from rotavg.io.glomap import GLOMAP
from rotavg.io.lines import check_finite, content_lines, is_number, number_table
from rotavg.io.registry import HEAD_SIZE, read_bytes
from rotavg.io.text import SOLUTION_HEADER

KINDS = ("text", "csv", "npz", "g2o", "glomap")
_EXPECTED = "expected rotations: id qx qy qz qw"


def read_rotations(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    convention: Convention | None = None,
) -> tuple[IdArray, NDArray[np.float64]]:
    """Read absolute rotations.

    Args:
        path: a text or CSV file of `id qx qy qz qw`, an npz archive of a solution, a g2o file with
            vertices, or GLOMAP's rotations `NAME qw qx qy qz`; told by the content, GLOMAP's by
            their name (*glomap_rotations.txt).
        format: one of `KINDS`, to leave nothing to be told.
        convention: the family of the rotations, "pose" or "vision", where text and npz leave that
            open; "pose" by default.

    Returns:
        The ids (n,) and the rotations (n, 3, 3) world_from_node.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds no rotations; the message names the line and the reason.
    """
    path = Path(path)
    data = read_bytes(FORMATS, path)
    kind = _kind(path, data) if format is None else format
    if kind not in KINDS:
        known = ", ".join(KINDS)
        raise FormatError(f"{kind!r} holds no rotations, expected one of {known}", path=path)
    family = convention or ("vision" if kind == "glomap" else "pose")
    if convention is not None and kind == "g2o" and convention != "pose":
        raise FormatError("g2o is in the pose family by definition", path=path)
    if kind == "glomap" and family != "vision":
        raise FormatError("glomap is in the vision family by definition", path=path)
    if kind == "npz":
        nodes, rotations = _from_npz(path, data)
    elif kind == "g2o":
        nodes, rotations = _from_vertices(path, data)
    else:
        nodes, rotations = _from_lines(path, data, kind)
    return nodes, convert_family(rotations, family)


def _kind(path: Path, data: bytes) -> str:
    if data.startswith(b"PK\x03\x04"):
        return "npz"
    if G2O.recognises(data[:HEAD_SIZE]) or TORO.recognises(data[:HEAD_SIZE]):
        return "g2o"
    return "glomap" if GLOMAP.is_name(path) else "text"


def _from_lines(path: Path, data: bytes, kind: str) -> tuple[IdArray, NDArray[np.float64]]:
    ids: list[bytes] = []
    rows: list[bytes] = []
    lines: list[int] = []
    for line, text in content_lines(path, data.replace(b",", b" ")):
        fields = text.split()
        if not lines and [f.decode(errors="replace").lower() for f in fields] == SOLUTION_HEADER:
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
    if kind == "glomap":
        table = xyzw_from_wxyz(table)
    return _nodes(path, [field.decode(errors="replace") for field in ids]), (
        matrices_from_quaternions(table)
    )


def _from_vertices(path: Path, data: bytes) -> tuple[IdArray, NDArray[np.float64]]:
    names: list[str] = []
    rotations = [np.empty((0, 3, 3))]
    for dialect in DIALECTS:
        rows: list[bytes] = []
        lines: list[int] = []
        for line, text in content_lines(path, data):
            fields = text.split(None, 2)
            if fields[0] != dialect.vertex:
                continue
            if len(fields) < 3:
                raise FormatError("the vertex has no pose", path=path, line=line)
            names.append(fields[1].decode(errors="replace"))
            rows.append(fields[2])
            lines.append(line)
        if not lines:
            continue
        table = number_table(path, rows, lines, dialect.num_pose)
        check_finite(path, table, lines)
        turns = table[:, dialect.dimension :]
        bad = first_bad_quaternion(turns) if dialect.turn == 4 else None
        if bad is not None:
            raise FormatError(bad[1], path=path, line=lines[bad[0]])
        rotations.append(dialect.rotations(turns))
    if not names:
        tags = ", ".join(dialect.vertex.decode() for dialect in DIALECTS)
        raise FormatError(f"the file has no vertices, expected lines {tags}", path=path)
    return _nodes(path, names), np.concatenate(rotations)


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
            if "edges" in archive.files and str(archive.get("kind", "graph")) != "solution":
                raise FormatError("found a graph, expected absolute rotations", path=path)
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

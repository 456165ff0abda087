"""TUM trajectories, for evo and other evaluations: pose family, quaternions xyzw.

    timestamp x y z qx qy qz qw

The time stamp is the node's id; a name will do if it is a number. Positions are solved for where
the graph has translations (see `rotavg.positions`) and zero where it has none. Of a trajectory the
rotations are read, with the time stamps as they are spelt for ids.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rotavg.base.errors import FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import AbsoluteRotations, RotationReader, is_header, read_fields
from rotavg.io.lines import content_lines, exactly, is_number, shown
from rotavg.io.placed import positions_of
from rotavg.io.registry import Format, Writable

_COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")
_TITLE = re.compile(rb"^#\s*timestamp(\s+\S+){3}\s+qx\s+qy\s+qz\s+qw\s*$", re.MULTILINE)
_LENGTH_TOLERANCE = 1e-2  # of quaternions that somebody rounded


def read_tum_rotations(path: Path, data: bytes) -> AbsoluteRotations:
    """Read the rotations of a trajectory."""
    return read_fields(path, _rows(path, data), _COLUMNS, node="timestamp")


def _rows(path: Path, data: bytes) -> Iterator[tuple[int, list[bytes]]]:
    """(line number, fields) of every pose; FormatError for a time stamp that is no number."""
    first = True
    for line, text in content_lines(path, data):
        fields = text.split()
        if not is_number(fields[0]) and not (first and is_header(fields, _COLUMNS)):
            found = f"found {shown(fields[0])}, expected a time stamp, which is a number"
            hint = f"(tum is {' '.join(_COLUMNS)})"
            raise FormatError(f"{found} {hint}", path=path, line=line)
        first = False
        yield line, fields


def write_tum(path: Path, item: Writable) -> bytes:
    """The content of a trajectory, in the order of its time stamps."""
    assert not isinstance(item, MeasurementGraph)
    solution = item
    graph = solution.graph
    stamps = [str(node) for node in graph.nodes.tolist()]
    for stamp in stamps:
        if not is_number(stamp.encode()) or not np.isfinite(float(stamp)):
            found = f"found the node {stamp!r}"
            raise FormatError(f"{found}, expected a number: it is the time stamp", path=path)
    where = positions_of(solution)
    if where is None:
        where = np.zeros((graph.num_nodes, 3))
    rows = np.hstack([where, solution.quaternions])
    lines = [f"# {' '.join(_COLUMNS)}"]
    for k in sorted(range(len(stamps)), key=lambda k: float(stamps[k])):
        lines.append(" ".join([stamps[k], *exactly(rows[k])]))
    return "\n".join([*lines, ""]).encode()


def _looks_like_tum(head: bytes) -> bool:
    """Whether there is the usual title, or eight numbers a line that end in a unit quaternion."""
    if b"\0" in head:
        return False
    if _TITLE.search(head):
        return True
    whole = head[: head.rfind(b"\n") + 1] or head
    rows = [text.split() for _, text in content_lines(Path(), whole)]
    if not rows or any(len(row) != len(_COLUMNS) or not all(map(is_number, row)) for row in rows):
        return False
    with np.errstate(over="ignore"):
        length = np.linalg.norm(np.array([row[4:] for row in rows], dtype=np.float64), axis=1)
    return bool((np.abs(length - 1) < _LENGTH_TOLERANCE).all())


TUM = Format(
    name="tum",
    suffixes=(".tum",),
    recognises=lambda head: head.startswith(b"# timestamp "),
    read=None,
    has_graphs=False,
    write=write_tum,
    rotations=RotationReader(_COLUMNS, read_tum_rotations, _looks_like_tum, (".tum",)),
    has_positions=True,
)

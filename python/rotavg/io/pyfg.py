"""PyFG, the text of PyFactorGraph (Papalia et al. 2023): g2o's tags, times and names; pose family.

    VERTEX_SE3:QUAT time A0  x y z  qx qy qz qw
    EDGE_SE3:QUAT time A0 A1  x y z  qx qy qz qw  21 values
    EDGE_SE2 time A0 A1  x y theta  6 values

    VERTEX_SE3:QUAT:PRIOR time A0  x y z  qx qy qz qw  21 values
    VERTEX_SE2:PRIOR time A0  x y theta  6 values

The values are the upper triangle of the covariance, translation first. Priors of poses are read
where they are used; landmarks and ranges are not.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.angles import angle_notes
from rotavg.io.dialects import G2O_2D, G2O_3D, Dialect
from rotavg.io.lines import check_finite, content_lines, is_number, number_table, shown
from rotavg.io.measured_poses import in_space, inverse, measured_poses, turned
from rotavg.io.places import Places
from rotavg.io.pose_priors import PosePrior, PriorsOfFile, of_poses, tell
from rotavg.io.registry import Format, ReadOptions, how_used

Floats = NDArray[np.float64]

_EDGES = {dialect.edge: dialect for dialect in (G2O_3D, G2O_2D)}
_VERTICES = {dialect.vertex: dialect for dialect in (G2O_3D, G2O_2D)}
_PRIORS = {dialect.vertex + b":PRIOR": dialect for dialect in (G2O_3D, G2O_2D)}
# A time and a name, or landmarks, which g2o spells otherwise.
_TAG = re.compile(
    rb"^[ \t]*((VERTEX|EDGE)_SE[23](:QUAT)?(:PRIOR)?[ \t]+[-+.\deE]+[ \t]+[A-Za-z]"
    rb"|VERTEX_XYZ?[ \t]+[A-Za-z]|EDGE_RANGE[ \t]+[-+.\deE]+[ \t]+[A-Za-z])",
    re.MULTILINE,
)


def read_pyfg(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the relative poses, and keep priors; other lines are counted and told."""
    rows: dict[Dialect, list[_Line]] = defaultdict(list)
    nodes: dict[Dialect, list[bytes]] = defaultdict(list)
    priors: dict[Dialect, list[tuple[int, bytes]]] = defaultdict(list)
    others: Counter[str] = Counter()
    for line, text in content_lines(path, data):
        tag = text.split(None, 1)[0]
        if tag in _EDGES:
            rows[_EDGES[tag]].append(_named(path, line, text, 2))
        elif tag in _VERTICES:
            nodes[_VERTICES[tag]] += _named(path, line, text, 1).names
        elif tag in _PRIORS:
            priors[_PRIORS[tag]].append((line, text))
        else:
            others[shown(tag)[1:-1]] += 1
    dialect = max(rows, key=lambda d: len(rows[d])) if rows else None
    others += Counter({d.edge.decode(): len(r) for d, r in rows.items() if d is not dialect})
    for tag, of_tag in _PRIORS.items():
        if of_tag is not dialect and priors[of_tag]:
            others[tag.decode()] += len(priors[of_tag])
    if dialect is None:
        told = ", ".join(f"{tag}: {count}" for tag, count in others.most_common(5))
        found = "the file has no edges: no line EDGE_SE3:QUAT or EDGE_SE2"
        raise FormatError(found + (f"; found {told}" if told else ""), path=path)
    notes: tuple[str, ...] = ()
    if others:
        told = ", ".join(f"{tag}: {count}" for tag, count in others.most_common(5))
        notes += (f"{sum(others.values())} other lines skipped ({told})",)
    source = None
    if priors[dialect]:
        source = PriorsOfFile(path, len(priors[dialect]), priors[dialect], _read_priors)
        notes += (f"{source.knows}{how_used(path)}",)
    places, rotations, vectors, omega, more = _in_space(path, dialect, rows[dialect])
    edges = [(_name(i), _name(j)) for i, j in (row.names for row in rows[dialect])]
    seen = dict.fromkeys(name for pair in edges for name in pair)
    known = dict.fromkeys(map(_name, nodes[dialect]))
    return measured_poses(
        path, places, edges, rotations, vectors, omega, options, dimension=dialect.dimension,
        nodes=np.array(list({**known, **seen})), notes=notes + more, source=source,
    )  # fmt: skip


class _Line(NamedTuple):
    """Its number, the names after the time, and the rest."""

    line: int
    names: list[bytes]
    rest: bytes


def _named(path: Path, line: int, text: bytes, count: int) -> _Line:
    fields = text.split(None, 2 + count)
    if len(fields) < 2 + count or not is_number(fields[1]):
        found = f"found {b' '.join(text.split()[:4]).decode(errors='replace')}"
        expected = f"expected a time and {'two names' if count == 2 else 'a name'}"
        raise FormatError(f"{found}, {expected} after the tag", path=path, line=line)
    return _Line(line, fields[2 : 2 + count], b"".join(fields[2 + count :]) or b"?")


def _in_space(
    path: Path, dialect: Dialect, rows: Sequence[_Line]
) -> tuple[Places, Floats, Floats, Floats, tuple[str, ...]]:
    """Rotations (m, 3, 3), translations (m, 3), information (m, 6, 6), and notes."""
    lines = [row.line for row in rows]
    columns = dialect.num_pose + len(dialect.order)
    table = number_table(path, [row.rest for row in rows], lines, columns)
    words = [word.replace("information", "covariance") for word in dialect.words]
    check_finite(path, table, lines, words)
    poses, places = table[:, : dialect.num_pose], Places(lines=lines)
    turns = poses[:, dialect.dimension :]
    if dialect is G2O_3D:
        rotations, notes = turned(path, places, turns)
    else:
        rotations, notes = dialect.rotations(turns), angle_notes(turns, lines)
    omega = inverse(path, dialect.matrices(table[:, dialect.num_pose :]), places)
    omega = in_space(omega) if dialect is G2O_2D else omega
    return places, rotations, dialect.translations(poses), omega, notes


def _read_priors(path: Path, lines: Sequence[tuple[int, bytes]]) -> list[PosePrior]:
    rows = [_named(path, line, text, 1) for line, text in lines]
    dialect = _PRIORS[lines[0][1].split(None, 1)[0]]
    places, rotations, vectors, omega, notes = _in_space(path, dialect, rows)
    tell(path, notes)
    return of_poses(places, [_name(row.names[0]) for row in rows], rotations, vectors, omega)


def _name(field: bytes) -> str:
    return field.decode(errors="replace")


PYFG = Format(
    name="pyfg",
    suffixes=(".pyfg",),
    recognises=lambda head: b"\0" not in head and _TAG.search(head) is not None,
    read=read_pyfg,
    write=None,
)

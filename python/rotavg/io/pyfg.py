"""PyFG, the text of PyFactorGraph (Papalia et al. 2023): g2o's tags, times and names; pose family.

    VERTEX_SE3:QUAT time A0  x y z  qx qy qz qw
    EDGE_SE3:QUAT time A0 A1  x y z  qx qy qz qw  21 values
    EDGE_SE2 time A0 A1  x y theta  6 values

The values are the upper triangle of the covariance, translation first. Landmarks, ranges and priors
are not read.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import first_bad_quaternion
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.angles import angle_notes
from rotavg.io.dialects import G2O_2D, G2O_3D, Dialect
from rotavg.io.lines import check_finite, content_lines, is_number, number_table, shown
from rotavg.io.measured_poses import Places, in_space, inverse, measured_poses
from rotavg.io.registry import Format, ReadOptions
from rotavg.io.rounding import quaternion_notes

_EDGES = {dialect.edge: dialect for dialect in (G2O_3D, G2O_2D)}
_VERTICES = {dialect.vertex: dialect for dialect in (G2O_3D, G2O_2D)}
# A time and a name, or landmarks, which g2o spells otherwise.
_TAG = re.compile(
    rb"^[ \t]*((VERTEX|EDGE)_SE[23](:QUAT)?(:PRIOR)?[ \t]+[-+.\deE]+[ \t]+[A-Za-z]"
    rb"|VERTEX_XYZ?[ \t]+[A-Za-z]|EDGE_RANGE[ \t]+[-+.\deE]+[ \t]+[A-Za-z])",
    re.MULTILINE,
)


def read_pyfg(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the relative poses; other lines are counted and told."""
    rows: dict[Dialect, list[tuple[int, list[bytes]]]] = defaultdict(list)
    nodes: dict[Dialect, list[bytes]] = defaultdict(list)
    others: Counter[str] = Counter()
    for line, text in content_lines(path, data):
        fields = text.split()
        if fields[0] in _EDGES or fields[0] in _VERTICES:
            ids = 2 if fields[0] in _EDGES else 1
            if len(fields) < 2 + ids or not is_number(fields[1]):
                found = f"found {b' '.join(fields[:4]).decode(errors='replace')}"
                expected = f"expected a time and {'two names' if ids == 2 else 'a name'}"
                raise FormatError(f"{found}, {expected} after the tag", path=path, line=line)
            if ids == 2:
                rows[_EDGES[fields[0]]].append((line, fields[2:]))
            else:
                nodes[_VERTICES[fields[0]]].append(fields[2])
        else:
            others[shown(fields[0])[1:-1]] += 1
    if not rows:
        told = ", ".join(f"{tag}: {count}" for tag, count in others.most_common(5))
        found = "the file has no edges: no line EDGE_SE3:QUAT or EDGE_SE2"
        raise FormatError(found + (f"; found {told}" if told else ""), path=path)
    dialect = max(rows, key=lambda d: len(rows[d]))
    others += Counter({d.edge.decode(): len(r) for d, r in rows.items() if d is not dialect})
    lines = [line for line, _ in rows[dialect]]
    fields_of = [fields for _, fields in rows[dialect]]
    columns = dialect.num_pose + len(dialect.order)
    table = number_table(path, [b" ".join(f[2:]) or b"?" for f in fields_of], lines, columns)
    words = [word.replace("information", "covariance") for word in dialect.words]
    check_finite(path, table, lines, words)
    poses, places = table[:, : dialect.num_pose], Places(lines=lines)
    turns = poses[:, dialect.dimension :]
    notes: tuple[str, ...] = ()
    if others:
        told = ", ".join(f"{tag}: {count}" for tag, count in others.most_common(5))
        notes += (f"{sum(others.values())} other lines skipped ({told})",)
    if dialect is G2O_3D:
        bad = first_bad_quaternion(turns)
        if bad is not None:
            raise places.error(path, *bad)
        notes += quaternion_notes(path, turns, lines)
    else:
        notes += angle_notes(turns, lines)
    omega = inverse(path, dialect.matrices(table[:, dialect.num_pose :]), places)
    edges = [(_name(f[0]), _name(f[1])) for f in fields_of]
    seen = dict.fromkeys(name for pair in edges for name in pair)
    known = dict.fromkeys(map(_name, nodes[dialect]))
    return measured_poses(
        path, places, edges, dialect.rotations(turns), dialect.translations(poses),
        in_space(omega) if dialect is G2O_2D else omega, options,
        dimension=dialect.dimension, nodes=np.array(list({**known, **seen})), notes=notes,
    )  # fmt: skip


def _name(field: bytes) -> str:
    return field.decode(errors="replace")


PYFG = Format(
    name="pyfg",
    suffixes=(".pyfg",),
    recognises=lambda head: b"\0" not in head and _TAG.search(head) is not None,
    read=read_pyfg,
    write=None,
)

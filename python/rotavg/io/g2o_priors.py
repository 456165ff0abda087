"""Priors of poses in g2o's files.

    EDGE_SE3_PRIOR i k      x y z  qx qy qz qw  21 values     T_i times the offset k
    EDGE_SE3_XYZ_PRIOR i k  x y z  6 values                   the position of i, whatever the offset
    PARAMS_SE3OFFSET k      x y z  qx qy qz qw
    EDGE_PRIOR_SE2 i        x y theta  6 values
    EDGE_PRIOR_SE2_XY i     x y  3 values

The values are the upper triangle of the information, that about a pose in the frame of the prior,
translation first, that about a position in the world.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.io.dialects import G2O_2D, G2O_3D, Dialect
from rotavg.io.g2o_lines import Lines
from rotavg.io.lines import check_finite
from rotavg.io.measured_poses import in_space, turned
from rotavg.io.places import Places
from rotavg.io.pose_priors import PosePrior, PriorsOfFile, in_plane, of_poses, tell

Floats = NDArray[np.float64]

_OFFSET = b"PARAMS_SE3OFFSET"
_POSE_3D, _POSITION_3D = b"EDGE_SE3_PRIOR", b"EDGE_SE3_XYZ_PRIOR"
_POSE_2D, _POSITION_2D = b"EDGE_PRIOR_SE2", b"EDGE_PRIOR_SE2_XY"
_KINDS = {G2O_3D: (_POSE_3D, _POSITION_3D), G2O_2D: (_POSE_2D, _POSITION_2D)}
# Ids, and numbers after them.
_COLUMNS = {
    _OFFSET: (1, 7),
    _POSE_3D: (2, 7 + 21),
    _POSITION_3D: (2, 3 + 6),
    _POSE_2D: (1, 3 + 6),
    _POSITION_2D: (1, 2 + 3),
}
TAGS = frozenset(_COLUMNS)


def priors_in_lines(
    path: Path, dialect: Dialect | None, lines: Sequence[tuple[int, bytes]]
) -> tuple[PriorsOfFile | None, Counter[bytes]]:
    """Those of poses as the dialect has them, if any; and the tags of lines that are of no use.

    Args:
        path: the file.
        dialect: of the graph; None without one.
        lines: (number, text) of all that begin with one of `TAGS`.
    """
    kinds = () if dialect is None else _KINDS.get(dialect, ())
    tags = Counter(text.split(None, 1)[0] for _, text in lines)
    count = sum(tags[tag] for tag in kinds)
    used = {*kinds, _OFFSET} if tags[_POSE_3D] + tags[_POSITION_3D] else set(kinds)
    kept = [(line, text) for line, text in lines if text.split(None, 1)[0] in used]
    rest = Counter({tag: k for tag, k in tags.items() if not count or tag not in used})
    return PriorsOfFile(path, count, kept, _parse) if count else None, rest


def _parse(path: Path, lines: Sequence[tuple[int, bytes]]) -> list[PosePrior]:
    rows: dict[bytes, Lines] = defaultdict(Lines)
    for line, text in lines:
        tag = text.split(None, 1)[0]
        num_ids = _COLUMNS[tag][0]
        rows[tag].add(path, line, text.split(None, 1 + num_ids), num_ids)
    tables = {tag: _table(path, tag, found) for tag, found in rows.items()}
    result: list[PosePrior] = []
    if _POSE_3D in rows:
        result += _of_poses_3d(path, rows, tables)
    if _POSE_2D in rows:
        found, table = rows[_POSE_2D], tables[_POSE_2D]
        omega = in_space(G2O_2D.matrices(table[:, 3:]))
        poses = G2O_2D.rotations(table[:, 2:3]), G2O_2D.translations(table[:, :2])
        result += of_poses(Places(lines=found.lines), found.ids, *poses, omega)
    if _POSITION_3D in rows:
        found = rows[_POSITION_3D]  # each with a parameter, which says nothing here
        result += _of_positions(Places(lines=found.lines), found.ids[::2], tables[_POSITION_3D], 3)
    if _POSITION_2D in rows:
        found = rows[_POSITION_2D]
        result += _of_positions(Places(lines=found.lines), found.ids, tables[_POSITION_2D], 2)
    return result


def _table(path: Path, tag: bytes, found: Lines) -> Floats:
    table = found.numbers(path, _COLUMNS[tag][1])
    check_finite(path, table, found.lines)
    return table


def _of_poses_3d(
    path: Path, rows: dict[bytes, Lines], tables: dict[bytes, Floats]
) -> list[PosePrior]:
    offsets: dict[int, tuple[Floats, Floats]] = {}
    if _OFFSET in rows:
        turns, notes = turned(path, Places(lines=rows[_OFFSET].lines), tables[_OFFSET][:, 3:])
        tell(path, notes)
        offsets = dict(zip(rows[_OFFSET].ids, zip(turns, tables[_OFFSET])))
    found, table = rows[_POSE_3D], tables[_POSE_3D]
    nodes, parameters = found.ids[::2], found.ids[1::2]
    for k, line in zip(parameters, found.lines):
        if k not in offsets:
            reason = f"found the parameter {k}, expected a line {_OFFSET.decode()} {k} in the file"
            raise FormatError(reason, path=path, line=line)
    places = Places(lines=found.lines)
    rotations, notes = turned(path, places, table[:, 3:7])
    # T_i times the offset is what is known: turned back by the offset, the rotation is that of i.
    turns = np.array([offsets[k][0] for k in parameters])
    arms = np.array([offsets[k][1][:3] for k in parameters])
    omega = G2O_3D.matrices(table[:, 7:])
    both = np.zeros_like(omega)
    both[:, :3, :3] = both[:, 3:, 3:] = turns
    omega = both @ omega @ np.swapaxes(both, 1, 2)
    away = arms.any(axis=1)
    count = int((away & omega[:, :3, :3].any(axis=(1, 2))).sum())
    if count:
        what = f"what {count} prior{'s say' if count > 1 else ' says'} of positions is not used"
        notes += (f"{what}: the offset is not at the origin of its pose",)
    tell(path, notes)
    omega[away, :3, :3] = 0
    rotations = rotations @ np.swapaxes(turns, 1, 2)
    return of_poses(places, nodes, rotations, table[:, :3], omega)


def _of_positions(
    places: Places, nodes: Sequence[int], table: Floats, dimension: int
) -> list[PosePrior]:
    upper = np.triu_indices(dimension)
    result = []
    for k, (node, row) in enumerate(zip(nodes, table)):
        where, omega = np.zeros(3), np.zeros((dimension, dimension))
        where[:dimension] = row[:dimension]
        omega[upper] = omega.T[upper] = row[dimension:]
        about = omega if dimension == 3 else in_plane(omega)
        nothing = np.eye(3), np.zeros((3, 3))
        result.append(PosePrior(node, places.other(k), places.line(k), *nothing, where, about))
    return result

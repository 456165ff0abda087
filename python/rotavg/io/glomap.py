"""GLOMAP's texts for its rotation averager: vision family, quaternions wxyz.

    *relpose.txt    NAME1 NAME2 qw qx qy qz tx ty tz     x2 = R x1 + t
    *weight.txt     NAME1 NAME2 weight                   beside it, if there are weights
    NAME qw qx qy qz                                     a solution, camera_from_world

The weights of X_relpose.txt are looked for in X_weight.txt; a pair that is not there weighs 1. The
directions t have no scale and are not read; written are zeros.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError
from rotavg.graph.conventions import convert_family, quaternions_from_matrices, wxyz_from_xyzw
from rotavg.graph.ids import IdArray
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import AbsoluteRotations, RotationReader, read_fields
from rotavg.io.lines import (
    check_finite,
    content_lines,
    exactly,
    ids_of,
    is_number,
    number_table,
    plain_name,
)
from rotavg.io.registry import Format, ReadOptions, Writable, blame_line
from rotavg.io.rounding import quaternion_notes

_EXPECTED = "expected NAME1 NAME2 qw qx qy qz tx ty tz"
_ROTATION = ("NAME", "qw", "qx", "qy", "qz")


def read_glomap(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read relative poses, and the weights beside them."""
    names, table, lines = _pairs(path, data, 7, _EXPECTED, read=4)
    if not lines:
        raise FormatError(f"the file has no relative poses, {_EXPECTED}", path=path)
    ids = ids_of(path, names, lines).reshape(-1, 2)
    weights: NDArray[np.float64] | None = None
    notes = quaternion_notes(path, table, lines)
    if not options.unit_weights:
        weights, further = _weights(_weight_file(path), ids)
        notes += further
    with blame_line(path, lines):
        return MeasurementGraph.from_quaternions(
            ids,
            table,
            weights,
            order="wxyz",
            **options.of_graph,
            notes=notes,
        )


def read_glomap_rotations(path: Path, data: bytes) -> AbsoluteRotations:
    """Read a solution, camera_from_world."""
    rows = ((line, text.split()) for line, text in content_lines(path, data))
    return read_fields(path, rows, _ROTATION, node="NAME")


def write_glomap(path: Path, item: Writable) -> bytes | dict[Path, bytes]:
    """Relative poses of a graph, and the file of its weights; or the rotations of a solution."""
    graph = item if isinstance(item, MeasurementGraph) else item.graph
    spell = {node: plain_name(path, str(node)) for node in graph.nodes.tolist()}
    R = convert_family(np.asarray(item.rotations), GLOMAP.convention)
    rows = [" ".join(exactly(q)) for q in wxyz_from_xyzw(quaternions_from_matrices(R))]
    if not isinstance(item, MeasurementGraph):
        lines = [f"{name} {row}" for name, row in zip(spell.values(), rows)]
        return "\n".join([*lines, ""]).encode()
    pairs = [f"{spell[i]} {spell[j]}" for i, j in graph.edges.tolist()]
    poses = [f"{pair} {row} 0 0 0" for pair, row in zip(pairs, rows)]
    content = "\n".join([*poses, ""]).encode()
    # One that is there is another graph's, and would be read with this one.
    if (graph.weights == 1).all() and not _weight_file(path).exists():
        return content
    weights = [f"{pair} {w!r}" for pair, w in zip(pairs, graph.weights.tolist())]
    return {path: content, _weight_file(path): "\n".join([*weights, ""]).encode()}


def _weight_file(path: Path) -> Path:
    stem, found = re.subn("relpose", "weight", path.stem)
    return path.with_name((stem if found else path.stem + "_weight") + ".txt")


def _weights(file: Path, edges: IdArray) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """Weight (m,) of every edge, None where there is no file, and what the user should know."""
    if not file.exists():
        return None, (f"every pair weighs 1: there is no {file.name} beside the file",)
    try:
        data = file.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=file) from error
    names, table, lines = _pairs(file, data, 1, "expected NAME1 NAME2 weight", read=1)
    for line, weight in zip(lines, table[:, 0].tolist()):
        if weight != 0 and not 1e-100 <= weight <= 1e100:
            message = f"found the weight {weight:g}, expected 0 or one from 1e-100 to 1e100"
            raise FormatError(message, path=file, line=line)
    known: dict[frozenset[str], list[float]] = {}
    fields = [name.decode(errors="replace") for name in names]
    for i, j, weight in zip(fields[::2], fields[1::2], table[:, 0].tolist()):
        known.setdefault(frozenset((i, j)), []).append(weight)
    pairs = [frozenset(map(str, edge)) for edge in edges.tolist()]
    for pair, times in Counter(pairs).items():
        # Parallel edges have a line each, in their order; otherwise the last line is that of all.
        if pair in known and len(known[pair]) != times:
            known[pair] = known[pair][-1:] * times
    left = {pair: iter(weights) for pair, weights in known.items()}
    found = [next(left[pair]) if pair in left else None for pair in pairs]
    missing = found.count(None)
    note = (f"{missing} pairs that are not in {file.name} weigh 1",) if missing else ()
    weights = np.array([1.0 if weight is None else weight for weight in found])
    return weights, (f"weights from {file.name}", *note)


def _pairs(
    path: Path, data: bytes, columns: int, expected: str, *, read: int
) -> tuple[list[bytes], NDArray[np.float64], list[int]]:
    """Names (2 m) and the first numbers (m, read) of lines `NAME1 NAME2 numbers`, and the lines.

    There are so many `columns` of numbers; what is not read need not be finite.
    """
    names: list[bytes] = []
    rows: list[bytes] = []
    lines: list[int] = []
    for line, text in content_lines(path, data):
        fields = text.split(None, 2)
        if len(fields) < 3:
            found = f"found {len(fields)} fields"
            raise FormatError(f"{found}, {expected}", path=path, line=line)
        names += fields[:2]
        rows.append(fields[2])
        lines.append(line)
    table = number_table(path, rows, lines, columns) if lines else np.empty((0, columns))
    table = table[:, :read]
    check_finite(path, table, lines)
    return names, table, lines


def _looks_like_poses(head: bytes) -> bool:
    if b"\0" in head:
        return False
    for _, text in content_lines(Path(), head):
        fields = text.split()
        return len(fields) == 9 and all(map(is_number, fields[2:]))
    return False


GLOMAP = Format(
    name="glomap",
    suffixes=("*relpose.txt", "*glomap_rotations.txt"),
    recognises=_looks_like_poses,
    read=read_glomap,
    write=write_glomap,
    has_isolated=False,
    convention="vision",
    # Their content would fit a text solution without its header as well.
    rotations=RotationReader(_ROTATION, read_glomap_rotations, suffixes=("*glomap_rotations.txt",)),
)

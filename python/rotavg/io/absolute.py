"""Absolute rotations in files: what a format says of them, and what all that have them share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import Brief
from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.conventions import first_bad_quaternion, matrices_from_quaternions
from rotavg.graph.ids import IdArray, as_nodes
from rotavg.io.lines import check_finite, ids_of, number_table
from rotavg.io.rounding import quaternion_notes

QUATERNION = ("qx", "qy", "qz", "qw")


@dataclass(frozen=True, eq=False)
class AbsoluteRotations(Brief):
    """The rotations of n nodes.

    Attributes:
        nodes: (n,) distinct ids.
        rotations: (n, 3, 3); of a reader in the family of its format.
        component: (n,) labels of components, each with a gauge of its own; None if not told.
        image_ids: (n,) what COLMAP numbers its images by; None in other formats.
        notes: what the reader wants its user to know.
    """

    nodes: IdArray
    rotations: NDArray[np.float64]
    component: NDArray[np.int64] | None = None
    image_ids: IdArray | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class RotationReader:
    """How a format carries absolute rotations.

    Attributes:
        columns: what the fields between blanks of a line are; none where it is not lines of those.
        read: (path, whole content) -> rotations; raises FormatError.
        recognises: whether the beginning of a file (up to 64 KiB) can be nothing else.
        suffixes: names that leave no doubt, spelt as in `Format`.
    """

    columns: tuple[str, ...]
    read: Callable[[Path, bytes], AbsoluteRotations]
    recognises: Callable[[bytes], bool] = lambda head: False
    suffixes: tuple[str, ...] = ()


def read_fields(
    path: Path, rows: Iterable[tuple[int, list[bytes]]], words: Sequence[str], node: str = ""
) -> AbsoluteRotations:
    """Rotations of rows of fields that are a quaternion, a node and what else `words` say.

    Args:
        path: the file, for errors.
        rows: (line number, fields); the first may be a header of the words.
        words: what each field is; among them those of `QUATERNION`.
        node: the word of the field with the id. Without one, nodes are counted from 0.

    Raises FormatError, which names the line.
    """
    ids: list[bytes] = []
    numbers: list[bytes] = []
    lines: list[int] = []
    places = [words.index(word) for word in QUATERNION]
    expected = f"expected {' '.join(words)}"
    for line, fields in rows:
        if not lines and is_header(fields, words):
            continue
        if len(fields) != len(words):
            found = f"found {len(fields)} fields" if len(fields) > 1 else "found 1 field"
            raise FormatError(f"{found}, {expected}", path=path, line=line)
        ids.append(fields[words.index(node)] if node else str(len(ids)).encode())
        numbers.append(b" ".join([fields[place] for place in places]))
        lines.append(line)
    if not lines:
        raise FormatError(f"the file has no rotations, {expected}", path=path)
    table = number_table(path, numbers, lines, len(QUATERNION))
    check_finite(path, table, lines, QUATERNION)
    notes = check_quaternions(path, table, lines)
    nodes = distinct(path, ids_of(path, ids, lines), lines)
    return AbsoluteRotations(nodes, matrices_from_quaternions(table), notes=notes)


def is_header(fields: Sequence[bytes], words: Sequence[str]) -> bool:
    """Whether the fields are just these words."""
    return [f.decode(errors="replace").lower() for f in fields] == [w.lower() for w in words]


def check_quaternions(
    path: Path, table: NDArray[np.float64], lines: Sequence[int]
) -> tuple[str, ...]:
    """What to tell of quaternions (m, 4); FormatError names the line of one that is no rotation."""
    bad = first_bad_quaternion(table)
    if bad is not None:
        raise FormatError(bad[1], path=path, line=lines[bad[0]])
    return quaternion_notes(path, table, lines)


def labels_of(components: Sequence[bytes]) -> NDArray[np.int64]:
    """Numbers (n,) from 0 for the labels of components, whatever they are."""
    return np.asarray(np.unique(np.array(components), return_inverse=True)[1], dtype=np.int64)


def distinct(path: Path, ids: IdArray | Sequence[int], lines: Sequence[int] = ()) -> IdArray:
    """The ids (n,) of nodes; FormatError if they are none, or one comes twice."""
    seen: dict[object, int] = {}
    for node, line in zip(np.ravel(ids).tolist(), lines):
        if node in seen:
            found = f"node {node!r} is listed more than once, before in line {seen[node]}"
            raise FormatError(found, path=path, line=line)
        seen[node] = line
    try:
        return as_nodes(ids)
    except GraphError as error:
        raise FormatError(str(error), path=path) from None

"""1DSfM data sets (Wilson and Snavely 2014): a folder with EGs.txt, cc.txt and list.txt.

    EGs.txt   i j  R11 R12 ... R33  t1 t2 t3
    cc.txt    one id per line: the largest component; edges of other nodes are left out
    list.txt  one image per line, its name, then often 0 and a focal length; ids are line numbers
              from 0

The published R_ij is R_i R_j^T for R_i = camera_from_world, which is i_from_j: pose family. Nodes
have the names in list.txt, or their ids where it is missing. There is no place for weights.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError
from rotavg.graph.ids import IdArray
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import bulk
from rotavg.io.lines import (
    BYTE_ORDER_MARK,
    check_finite,
    content_lines,
    integer,
    number_table,
    plain_name,
    shown,
)
from rotavg.io.registry import Format, ReadOptions, Writable, blame_line
from rotavg.io.rounding import MATRIX_TOLERANCE, matrix_notes

# What Bundler's lists may have after a name, in which there may be blanks.
_FOCAL = re.compile(rb"\s+0\s+[-+.0-9eE]+$")
_Edges = tuple[IdArray, NDArray[np.float64], Sequence[int]]
_EXPECTED = "expected i j, 9 numbers of R, 3 of t"


def read_onedsfm(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read EGs.txt and what there is of the two files beside it."""
    edges, table, lines = _edges_at_once(data) or _edges(path, data)
    kept, notes = _component(path, edges)
    edges, matrices = edges[kept], table[kept].reshape(-1, 3, 3)
    lines = np.array(lines)[kept].tolist()
    with blame_line(path, lines):
        return MeasurementGraph(
            _named(path, edges),
            matrices,
            **options.of_graph,
            notes=notes + matrix_notes(path, matrices, lines),
            tolerance=MATRIX_TOLERANCE,
        )


def _edges_at_once(data: bytes) -> _Edges | None:
    """Edges, the numbers of their rotations, and their lines, where every line is as usual."""
    found = bulk.read_tagged(data, [(b"", bulk.INTEGER * 2 + bulk.NUMBER * 12)])
    if found is None or not found[0][0].lines:
        return None
    table = found[0][0]
    return table.ids, table.numbers[:, :9], table.lines


def _edges(path: Path, data: bytes) -> _Edges:
    """The same, line by line; FormatError that names the first that is no edge."""
    ids: list[int] = []
    rows: list[bytes] = []
    lines: list[int] = []
    for line, text in content_lines(path, data):
        fields = text.split(None, 2)
        try:
            ids += map(int, fields[:2])
        except ValueError:
            found = " ".join(map(shown, fields[:2]))
            raise FormatError(f"found {found} for i j, {_EXPECTED}", path=path, line=line) from None
        if len(fields) < 3:
            raise FormatError(f"the line is truncated, {_EXPECTED}", path=path, line=line)
        rows.append(fields[2])
        lines.append(line)
    if not lines:
        raise FormatError(f"the file has no edges, {_EXPECTED}", path=path)
    table = number_table(path, rows, lines, 12)[:, :9]
    check_finite(path, table, lines, [f"r{k // 3 + 1}{k % 3 + 1}" for k in range(9)])
    return np.array(ids, dtype=object).reshape(-1, 2), table, lines


def write_onedsfm(path: Path, item: Writable) -> dict[Path, bytes]:
    """The three files of a graph; list.txt only where nodes have names."""
    assert isinstance(item, MeasurementGraph)
    graph = item
    named = graph.nodes.dtype.kind == "U"
    if not named and path.with_name("list.txt").exists():
        found = "found a list.txt beside it, which names the nodes of another graph"
        raise FormatError(f"{found}, expected none: this one's are numbers", path=path)
    ids = graph.indices if named else graph.edges
    nodes = range(graph.num_nodes) if named else graph.nodes.tolist()
    files = {"cc.txt": [str(node) for node in nodes]}
    if named:
        files["list.txt"] = [plain_name(path, name) for name in graph.nodes.tolist()]
    edges = bulk.write_rows(
        ids.astype(np.int64) if named else ids, graph.rotations.reshape(-1, 9), end=" 0 0 0"
    )
    return {path: edges} | {
        path.with_name(name): "\n".join([*lines, ""]).encode() for name, lines in files.items()
    }


def _beside(path: Path, name: str) -> bytes | None:
    """The content of a file beside EGs.txt; None if it is not there."""
    file = path.with_name(name)
    try:
        return file.read_bytes() if file.exists() else None
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=file) from error


def _component(path: Path, edges: IdArray) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Which edges (m,) cc.txt keeps, and a note if some go."""
    data = _beside(path, "cc.txt")
    kept = np.ones(len(edges), dtype=np.bool_)
    if data is None:
        return kept, ()
    component = set()
    for line, text in content_lines(path.with_name("cc.txt"), data):
        try:
            component.add(integer(text))
        except ValueError:
            found = f"found {shown(text.strip())}, expected an id"
            raise FormatError(found, path=path.with_name("cc.txt"), line=line) from None
    kept = np.array([i in component and j in component for i, j in edges.tolist()])
    if not kept.any():
        raise FormatError("cc.txt keeps none of the edges", path=path)
    left = len(kept) - int(np.count_nonzero(kept))
    return kept, (f"{left} edges outside the component in cc.txt left out",) if left else ()


def _named(path: Path, edges: IdArray) -> IdArray:
    """The edges with the names in list.txt, whose lines are numbered by the ids, for ids."""
    data = _beside(path, "list.txt")
    if data is None:
        return edges
    file = path.with_name("list.txt")
    next(content_lines(file, data), None)  # refuses what is binary
    images = data.removeprefix(BYTE_ORDER_MARK).rstrip().splitlines()
    names = [_FOCAL.sub(b"", image.strip()).decode(errors="replace") for image in images]
    low, high = edges.min(), edges.max()
    if low < 0 or high >= len(names):
        found = f"found the node {low if low < 0 else high}"
        raise FormatError(
            f"{found}, expected ids 0 to {len(names) - 1}: list.txt has {len(names)} images",
            path=path,
        )
    for k in edges.ravel().tolist():
        if not names[k]:
            found = f"found a blank line, expected the name of node {k}"
            raise FormatError(found, path=file, line=k + 1)
    given = [name for name in names if name]
    if len(set(given)) < len(given):
        return edges
    return np.array(names)[edges.astype(np.int64)]


def _looks_like_edges(head: bytes) -> bool:
    if b"\0" in head:
        return False
    for _, text in content_lines(Path(), head):
        fields = text.split()
        return len(fields) == 14 and all(field.isdigit() for field in fields[:2])
    return False


ONEDSFM = Format(
    name="1dsfm",
    suffixes=("egs.txt",),
    recognises=_looks_like_edges,
    read=read_onedsfm,
    write=write_onedsfm,
    has_isolated=False,
    has_solutions=False,
    has_weights=False,
    main_file="EGs.txt",
)

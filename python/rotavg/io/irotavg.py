"""Text of iRotAvg and RCD (Parra et al. 2019, 2021): vision family, quaternions wxyz.

    m n f
    i j  qw qx qy qz       m lines, i < j: R_ij = R_j R_i^T
    qw qx qy qz            at least f lines: absolute rotations, of which the first f are fixed

Their programs replace ids by their rank, so that the k-th absolute rotation is that of the node
with the k-th lowest id. The fixed ones are kept beside the graph, as its `source`; the others are
not read. A solution is n lines qw qx qy qz, R_i = camera_from_world, in the order of the nodes:
read, it has the ids 0 to n - 1.
There is no place for weights.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import (
    convert_family,
    quaternions_from_matrices,
    wxyz_from_xyzw,
)
from rotavg.graph.ids import IdArray, as_edges, unique_ids
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import AbsoluteRotations, RotationReader, read_fields
from rotavg.io.lines import check_finite, content_lines, exactly, number_table, shown
from rotavg.io.registry import Format, ReadOptions, Writable, blame_line, how_used
from rotavg.io.rounding import quaternion_notes


@dataclass(frozen=True, eq=False)
class FixedRotations:
    """What a file says is known: rotations (k, 3, 3) world_from_node of the nodes (k,)."""

    nodes: IdArray
    rotations: NDArray[np.float64]

    @property
    def knows(self) -> str:
        """What it knows beside the measurements."""
        return f"{len(self.nodes)} rotation{'s' * (len(self.nodes) != 1)} held fixed"

    def select(self, edges: NDArray[np.bool_]) -> FixedRotations:
        """The same: they are of nodes."""
        return self


_ROTATION = ("qw", "qx", "qy", "qz")
_ID = re.compile(rb"-?[0-9]{1,20}")


def read_irotavg(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the relative rotations."""
    content = content_lines(path, data)
    line, header = next(content, (1, b""))
    try:
        m, _, f = map(int, header.split())
    except ValueError:
        found = f"found {shown(header.strip())}, expected three integers m n f"
        raise FormatError(found, path=path, line=line) from None
    ids: list[int] = []
    rows: list[bytes] = []
    lines: list[int] = []
    further: list[tuple[int, bytes]] = []
    for line, text in content:
        if len(rows) == m:
            further.append((line, text))
            continue
        fields = text.split(None, 2)
        if len(fields) < 3 or not all(map(_ID.fullmatch, fields[:2])):
            found = f"found {shown(text.strip())}"
            raise FormatError(f"{found}, expected i j qw qx qy qz", path=path, line=line)
        ids += map(int, fields[:2])
        rows.append(fields[2])
        lines.append(line)
    if len(rows) < m or m < 1:
        raise FormatError(f"found {len(rows)} relative rotations, expected m = {m}", path=path)
    table = number_table(path, rows, lines, 4)
    check_finite(path, table, lines, ("qw", "qx", "qy", "qz"))
    notes = quaternion_notes(path, table, lines)
    with blame_line(path, lines):
        edges = as_edges(np.array(ids, dtype=object).reshape(-1, 2))
        fixed, more = _fixed(path, edges, further, f)
        return MeasurementGraph.from_quaternions(
            edges, table, order="wxyz", **options.of_graph, notes=notes + more, source=fixed
        )


def _fixed(
    path: Path, edges: IdArray, rows: list[tuple[int, bytes]], f: int
) -> tuple[FixedRotations | None, tuple[str, ...]]:
    """The first f of the absolute rotations, and what to tell."""
    nodes = unique_ids(edges)
    if not 0 <= f <= len(nodes):
        found = f"found f = {f} fixed rotations, expected 0 to {len(nodes)}, one for each node"
        raise FormatError(found, path=path)
    if len(rows) < f:
        found = f"found {len(rows)} absolute rotations, expected f = {f} at least"
        raise FormatError(found, path=path)
    left = len(rows) - f
    notes = (f"{left} absolute rotations that are not fixed not read",) if left else ()
    if f == 0:
        return None, notes
    found_here = read_fields(path, ((line, row.split()) for line, row in rows[:f]), _ROTATION)
    rotations = convert_family(found_here.rotations, IROTAVG.convention)
    fixed = FixedRotations(nodes[:f], rotations)
    return fixed, (*found_here.notes, *notes, f"{fixed.knows}{how_used(path)}")


def read_irotavg_rotations(path: Path, data: bytes) -> AbsoluteRotations:
    """Read a solution, camera_from_world, nodes counted from 0; or a graph's fixed rotations."""
    if _looks_like_ours(data):
        source = read_irotavg(path, data, ReadOptions(True, IROTAVG.convention, True)).source
        if not isinstance(source, FixedRotations):
            raise FormatError("the file has no fixed rotations (f = 0)", path=path)
        return AbsoluteRotations(source.nodes, convert_family(source.rotations, "vision"))
    rows = ((line, text.split()) for line, text in content_lines(path, data))
    return read_fields(path, rows, _ROTATION)


def write_irotavg(path: Path, item: Writable) -> bytes:
    """The content of a file of a graph (edges with i > j turned round), or of a solution."""
    if not isinstance(item, MeasurementGraph):
        R = convert_family(np.asarray(item.rotations), IROTAVG.convention)
        q = wxyz_from_xyzw(quaternions_from_matrices(R))
        return "\n".join([*(" ".join(exactly(row)) for row in q), ""]).encode()
    if item.nodes.dtype.kind == "U":
        found = f"nodes have names such as {item.nodes[0].item()!r}"
        raise FormatError(f"{found}, expected integers: iRotAvg knows no names", path=path)
    edges = item.edges.copy()
    turn = edges[:, 0] > edges[:, 1]
    edges[turn] = edges[turn][:, ::-1]
    R = np.where(turn[:, None, None], np.swapaxes(item.rotations, 1, 2), item.rotations)
    q = wxyz_from_xyzw(quaternions_from_matrices(convert_family(R, IROTAVG.convention)))
    lines = [f"{item.num_edges} {len(np.unique(edges))} 0"]
    lines += [" ".join([str(i), str(j), *exactly(row)]) for (i, j), row in zip(edges.tolist(), q)]
    return "\n".join([*lines, ""]).encode()


def _looks_like_ours(head: bytes) -> bool:
    if b"\0" in head:
        return False
    content = content_lines(Path(), head)
    sizes = next(content, (0, b""))[1].split()
    edge = next(content, (0, b""))[1].split()
    return len(sizes) == 3 and all(field.isdigit() for field in sizes) and len(edge) == 6


IROTAVG = Format(
    name="irotavg",
    suffixes=(".irotavg", ".rcd"),
    recognises=_looks_like_ours,
    read=read_irotavg,
    write=write_irotavg,
    has_isolated=False,
    convention="vision",
    has_weights=False,
    rotations=RotationReader(_ROTATION, read_irotavg_rotations, suffixes=(".irotavg", ".rcd")),
)

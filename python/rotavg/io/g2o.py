"""g2o, 3D pose graphs: EDGE_SE3:QUAT and VERTEX_SE3:QUAT; pose family, quaternions xyzw.

    VERTEX_SE3:QUAT i  x y z  qx qy qz qw
    EDGE_SE3:QUAT i j  x y z  qx qy qz qw  I11 I12 ... I66

An edge's rotation is R_ij = i_from_j as it stands. The 21 numbers are the upper triangle of its
information matrix, row by row, translation first; the weight is SE-Sync's concentration
kappa = 3 / (2 tr(Omega^-1)), Omega the lower right 3 x 3 block (Rosen et al. 2019).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.conventions import quaternions_from_matrices
from rotavg.errors import FormatError
from rotavg.graph import MeasurementGraph
from rotavg.ids import as_edges
from rotavg.io.lines import (
    BYTE_ORDER_MARK,
    check_finite,
    content_lines,
    exactly,
    number_table,
    shown,
)
from rotavg.io.registry import Format, Writable, blame_line

VERTEX, EDGE, FIX = b"VERTEX_SE3:QUAT", b"EDGE_SE3:QUAT", b"FIX"
_TAG_AT_LINE_START = re.compile(
    rb"^[ \t]*(VERTEX|EDGE)_[A-Z0-9_]+(:[A-Z0-9_]+)?[ \t]", re.MULTILINE
)
# Tag, id and translation; the quaternion; the rest of the line.
_VERTEX_LINE = re.compile(rb"(\s*(?:\S+\s+){5})[^\s#]+(?:\s+[^\s#]+){3}(.*)", re.DOTALL)
# Where the rotation block's upper triangle lies among the 21 values.
_ROTATION = [15, 16, 17, 18, 19, 20]
_LENGTH_WORTH_A_NOTE = 1e-3


@dataclass(frozen=True, eq=False)
class G2oSource:
    """The file as it was, and which of its lines the edges of the graph came from."""

    data: bytes = field(repr=False)
    edge_lines: NDArray[np.int64]  # (m,) from 1
    weights: NDArray[np.float64]  # (m,) as read

    def select(self, edges: NDArray[np.bool_]) -> G2oSource:
        """The source of the graph that keeps the edges (m,) marked True."""
        return replace(self, edge_lines=self.edge_lines[edges], weights=self.weights[edges])


def read_g2o(path: Path, data: bytes, unit_weights: bool) -> MeasurementGraph:
    """Read the edges of a 3D g2o file; lines with other tags are skipped, counted and told."""
    edges, vertices = _Lines(), _Lines()
    unknown: Counter[bytes] = Counter()
    for line, text in content_lines(path, data):
        fields = text.split(None, 3)
        if fields[0] == EDGE:
            edges.add(path, line, fields, num_ids=2)
        elif fields[0] == VERTEX:
            vertices.add(path, line, text.split(None, 2), num_ids=1)
        elif fields[0] != FIX:
            unknown[fields[0]] += 1
    if not edges.lines:
        tags = f", found {_listed(unknown)}" if unknown else ""
        raise FormatError(f"the file has no edges: no line EDGE_SE3:QUAT{tags}", path=path)
    if vertices.lines:  # kept for the writer; the estimates themselves are not used
        number_table(path, vertices.rows, vertices.lines, 7)

    lines = edges.lines
    table = number_table(path, edges.rows, lines, 28)
    check_finite(path, table, lines)
    quaternions, information = table[:, 3:7], table[:, 7:]
    weights = np.ones(len(lines)) if unit_weights else _weights(path, information, lines)
    source = G2oSource(data.removeprefix(BYTE_ORDER_MARK), np.array(lines), weights)
    notes = _notes(unknown, quaternions, lines)
    with blame_line(path, lines):
        ids = as_edges(np.array(edges.ids, dtype=object).reshape(-1, 2))
        return MeasurementGraph.from_quaternions(
            ids, quaternions, weights, source=source, notes=notes
        )


@dataclass
class _Lines:
    """The lines of one tag: ids, the text after them, and the line numbers."""

    ids: list[int] = field(default_factory=list)
    rows: list[bytes] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def add(self, path: Path, line: int, fields: list[bytes], num_ids: int) -> None:
        try:
            self.ids += map(int, fields[1 : 1 + num_ids])
        except ValueError:
            found = " ".join(map(shown, fields[1 : 1 + num_ids]))
            raise FormatError(
                f"found {found} for node ids, expected integers", path=path, line=line
            ) from None
        if len(fields) < 2 + num_ids:
            found = f"found only {len(fields) - 1} values after {shown(fields[0])}"
            raise FormatError(f"{found}, the line is truncated", path=path, line=line)
        self.rows.append(fields[-1])
        self.lines.append(line)


def write_g2o(path: Path, item: Writable) -> bytes:
    """The content of a g2o file of a graph or a solution.

    What came from a g2o file goes back into it: vertices keep id and translation and get the new
    quaternion, an edge line is dropped with its edge, an edge with a new weight has the rotation
    part of its information scaled to it, and every other byte stays. Anything else is written
    with zero translations and information diag(1, 1, 1, 2 w, 2 w, 2 w), which reads back as w.
    """
    graph = item if isinstance(item, MeasurementGraph) else item.graph
    if graph.nodes.dtype.kind == "U":
        found = f"nodes have names such as {graph.nodes[0].item()!r}"
        raise FormatError(f"{found}, expected integers: g2o knows no names", path=path)
    poses: dict[int, str] = {}
    if not isinstance(item, MeasurementGraph):
        rows = np.asarray(item.quaternions, dtype=np.float64)
        poses = {node: " ".join(exactly(q)) for node, q in zip(graph.nodes.tolist(), rows)}
    if isinstance(graph.source, G2oSource):
        return _put_back(graph.source, graph, poses)
    return "".join(f"{line}\n" for line in [*map(_vertex, poses.items()), *_edges(graph)]).encode()


def _put_back(source: G2oSource, graph: MeasurementGraph, poses: dict[int, str]) -> bytes:
    weights = dict(zip(source.edge_lines.tolist(), graph.weights.tolist()))
    changed = set(source.edge_lines[graph.weights != source.weights].tolist())
    missing = dict(poses)
    out: list[bytes] = []
    before_edges, ending = None, b""
    for line, text in enumerate(source.data.splitlines(keepends=True), start=1):
        fields = text.split(None, 2)
        if fields[:1] == [VERTEX]:
            node = int(fields[1])
            missing.pop(node, None)
            if node in poses:
                text = _VERTEX_LINE.sub(rb"\g<1>" + poses[node].encode() + rb"\g<2>", text, count=1)
        elif fields[:1] == [EDGE]:
            if before_edges is None:
                before_edges, ending = len(out), text[len(text.rstrip(b"\r\n")) :]
            if line not in weights:
                continue
            if line in changed:
                text = _reweighted(text, weights[line])
        out.append(text)
    out[before_edges:before_edges] = [
        _vertex(pose).encode() + (ending or b"\n") for pose in missing.items()
    ]
    return b"".join(out)


def _vertex(pose: tuple[int, str]) -> str:
    return f"VERTEX_SE3:QUAT {pose[0]} 0 0 0 {pose[1]}"


def _edges(graph: MeasurementGraph) -> Iterator[str]:
    quaternions = quaternions_from_matrices(graph.rotations)
    for (i, j), q, weight in zip(graph.edges.tolist(), quaternions, graph.weights):
        k = repr(2 * float(weight))
        information = f"1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 {k} 0 0 {k} 0 {k}"
        yield f"EDGE_SE3:QUAT {i} {j} 0 0 0 {' '.join(exactly(q))} {information}"


def _reweighted(text: bytes, weight: float) -> bytes:
    """The edge line with D Omega D for its information, D = diag(1, 1, 1, s, s, s)."""
    content, comment, rest = text.rstrip().partition(b"#")
    fields = content.split()
    information = np.array(fields[10:], dtype=np.float64)
    kappa = float(_kappa(information[None])[0])
    if kappa > 0:
        scale = np.repeat([1.0, np.sqrt(weight / kappa)], 3)
        information *= np.outer(scale, scale)[np.triu_indices(6)]
    else:  # it was read with unit weights: there is nothing to scale
        information[_ROTATION] = np.array([2, 0, 0, 2, 0, 2]) * weight
    new = b" ".join([*fields[:10], *(number.encode() for number in exactly(information))])
    ending = text[len(text.rstrip()) :]
    return new + (b" " + comment + rest if comment else b"") + ending


def _kappa(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """SE-Sync's concentration of information (m, 21); NaN where that is not positive definite."""
    block = information[:, _ROTATION]
    scale = np.abs(block).max(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c, d, e, f = (block / scale[:, None]).T  # [[a b c] [b d e] [c e f]]
        minors = a * d - b * b, a * f - c * c, d * f - e * e
        det = a * minors[2] - b * (b * f - c * e) + c * (b * e - c * d)
        kappa = 1.5 * scale * det / (minors[0] + minors[1] + minors[2])
    definite = (a > 0) & (minors[0] > 0) & (det > 0)
    return np.where(definite, kappa, np.nan)


def _weights(path: Path, information: NDArray[np.float64], lines: list[int]) -> NDArray[np.float64]:
    weights = _kappa(information)
    bad = np.isnan(weights)
    if bad.any():
        found = "the rotation part of the information matrix is not positive definite"
        hint = "expected one that is (or read with unit weights, which ignore it)"
        raise FormatError(f"{found}, {hint}", path=path, line=lines[int(np.argmax(bad))])
    return weights


def _notes(
    unknown: Counter[bytes], quaternions: NDArray[np.float64], lines: list[int]
) -> tuple[str, ...]:
    notes = []
    if unknown:
        count = sum(unknown.values())
        notes.append(
            f"{count} line{'s' * (count > 1)} with unknown tags skipped ({_listed(unknown)})"
        )
    off = np.abs(np.linalg.norm(quaternions, axis=1) - 1)
    worst = int(np.argmax(off))
    if off[worst] > _LENGTH_WORTH_A_NOTE:
        count = int(np.count_nonzero(off > _LENGTH_WORTH_A_NOTE))
        notes.append(
            f"{count} quaternion{'s' * (count > 1)} normalised whose length was not 1 "
            f"(off by up to {off[worst]:.3g}, in line {lines[worst]})"
        )
    return tuple(notes)


def _listed(tags: Counter[bytes]) -> str:
    listed = [f"{shown(tag)[1:-1]}: {count}" for tag, count in tags.most_common(5)]
    return ", ".join(listed + ["..."] * (len(tags) > 5))


G2O = Format(
    name="g2o",
    suffixes=(".g2o",),
    recognises=lambda head: _TAG_AT_LINE_START.search(head) is not None,
    read=read_g2o,
    write=write_g2o,
)

"""Writing pose graphs: back into the file that they were read from, or anew."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError, IncompleteWarning, SolverError
from rotavg.graph.covariances import information_to_write
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import bulk
from rotavg.io.dialects import G2O_2D, G2O_3D, TORO_2D, TORO_3D, Dialect
from rotavg.io.g2o_gauge import gauge_of, turned_along
from rotavg.io.lines import exactly
from rotavg.io.placed import held_by_priors, places_of, refined_positions, robust_shares
from rotavg.io.pose_priors import PriorsOfFile
from rotavg.io.registry import (
    SolutionLike,
    Writable,
    edges_to_write,
)
from rotavg.solving.anchors import moved_to
from rotavg.solving.positions import positions

Floats = NDArray[np.float64]

FIX = b"FIX"
_TILT_WORTH_A_WARNING = 1e-6  # radians


@dataclass(frozen=True, eq=False)
class PoseFile:
    """The file as it was, and which of its lines the edges of the graph came from."""

    data: bytes = field(repr=False)
    dialect: Dialect
    edge_lines: NDArray[np.int64]  # (m,) from 1
    weights: Floats  # (m,) as read
    nodes: frozenset[int] = field(repr=False)  # as read; FIX may name other things as well
    vertices: dict[int, Floats] = field(repr=False)  # the numbers (num_pose,) of each
    fixed: frozenset[int]
    pose_priors: PriorsOfFile | None = None

    @property
    def fixed_poses(self) -> dict[int, tuple[Floats, Floats]]:
        """Rotation (3, 3) and position (3,) of every vertex that is fixed and has a pose."""
        held = [node for node in sorted(self.fixed & self.nodes) if node in self.vertices]
        if not held:
            return {}
        poses = np.array([self.vertices[node] for node in held])
        turned = self.dialect.rotations(poses[:, self.dialect.dimension :])
        return dict(zip(held, zip(turned, self.dialect.translations(poses))))

    def select(self, edges: NDArray[np.bool_]) -> PoseFile:
        """The source of the graph that keeps the edges (m,) marked True."""
        return replace(self, edge_lines=self.edge_lines[edges], weights=self.weights[edges])


def write_g2o(path: Path, item: Writable) -> bytes:
    """The content of a g2o file of a graph or a solution.

    What came from a g2o file goes back into it. A vertex keeps its id and gets the new pose; one
    that the file fixes keeps its pose, too. A component without such stays in the world of the
    priors that the solution was found with, or else its first node keeps its pose: that is the
    gauge. Vertex and edge lines go with their nodes and edges; an edge with a new weight has the
    rotation part of its information scaled to it. Every other byte stays.

    Anything else is written with the inverse of its covariances, scaled by the weights unless these
    are the default 3 / tr, or with the information 2 w I of a rotation of weight w, which reads
    back as w; and with zero translations of unit information where the graph has none.
    """
    return _write(path, item, (G2O_3D, G2O_2D))


def write_toro(path: Path, item: Writable) -> bytes:
    """The content of a TORO file of a graph or a solution; as `write_g2o`."""
    return _write(path, item, (TORO_3D, TORO_2D))


def with_weights_to_write(graph: MeasurementGraph) -> MeasurementGraph:
    """The same graph, all of whose weights go into its file, also those as they were read."""
    if not isinstance(graph.source, PoseFile):
        return graph
    return MeasurementGraph(
        graph.edges,
        graph.rotations,
        graph.weights,
        graph.nodes,
        covariances=graph.covariances,
        translations=graph.translations,
        source=replace(graph.source, weights=np.full(graph.num_edges, np.nan)),
        notes=graph.notes,
    )


def kappa(omega: Floats) -> Floats:
    """SE-Sync's concentration of rotation information (m, 3, 3); NaN where not positive definite.

    kappa = 3 / (2 tr(Omega^-1)).
    """
    block = omega.reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
    scale = np.abs(block).max(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c, d, e, f = (block / scale[:, None]).T  # [[a b c] [b d e] [c e f]]
        minors = a * d - b * b, a * f - c * c, d * f - e * e
        det = a * minors[2] - b * (b * f - c * e) + c * (b * e - c * d)
        result = 1.5 * scale * det / (minors[0] + minors[1] + minors[2])
    definite = (a > 0) & (minors[0] > 0) & (det > 0)
    return np.where(definite, result, np.nan)


def _write(path: Path, item: Writable, dialects: tuple[Dialect, Dialect]) -> bytes:
    graph = item if isinstance(item, MeasurementGraph) else item.graph
    if graph.nodes.dtype.kind == "U":
        found = f"nodes have names such as {graph.nodes[0].item()!r}"
        raise FormatError(f"{found}, expected integers: g2o and TORO know no names", path=path)
    source = graph.source if isinstance(graph.source, PoseFile) else None
    if source is not None and source.dialect in dialects:
        return _put_back(path, source, item, graph)
    flat = source is not None and source.dialect.dimension == 2
    dialect = dialects[1] if flat else dialects[0]
    vertices = _isolated(dialect, graph)
    if not isinstance(item, MeasurementGraph):
        where = refined_positions(item)
        if where is None:
            where = _positions(path, item, item.rotations, {})
            if where is not None:
                where = moved_to(graph, where, places_of(item, *held_by_priors(item)))
        translations = np.zeros((graph.num_nodes, 3)) if where is None else where
        poses = _numbers(path, dialect, translations, item.rotations)
        vertices = dict(zip(graph.nodes.tolist(), poses))
    text = [f"{_vertex(dialect, node, pose)}\n" for node, pose in vertices.items()]
    return "".join(text).encode() + _edges(dialect, edges_to_write(item))


def _put_back(path: Path, source: PoseFile, item: Writable, graph: MeasurementGraph) -> bytes:
    dialect, nodes = source.dialect, set(graph.nodes.tolist())
    vertices, kept = _isolated(dialect, graph), dialect.num_pose
    if not isinstance(item, MeasurementGraph):
        vertices, kept = _new_vertices(path, source, item)
    edges = edges_to_write(item)
    assert isinstance(edges.source, PoseFile)
    written = {line: k for k, line in enumerate(edges.source.edge_lines.tolist())}
    missing = {node: pose for node, pose in vertices.items() if node not in source.vertices}
    # Tag, id and the numbers that stay; the numbers that change; the rest of the line.
    vertex_line = re.compile(
        rb"(\s*\S+(?:\s+[^\s#]+){%d})((?:\s+[^\s#]+){%d})(.*)"
        % (1 + kept, dialect.num_pose - kept),
        re.DOTALL,
    )
    gone = source.nodes - nodes
    of_gone = _priors_of(source, gone)
    out: list[bytes] = []
    before_edges, ending = None, b""
    for line, text in enumerate(source.data.splitlines(keepends=True), start=1):
        fields = text.split(None, 2)
        if fields[:1] == [dialect.vertex]:
            node = int(fields[1])
            if node not in nodes:
                continue
            if kept < dialect.num_pose and node not in source.fixed:
                numbers = " ".join(map(_short, vertices[node][kept:].tolist())).encode()
                text = vertex_line.sub(rb"\g<1> " + numbers + rb"\g<3>", text, count=1)
        elif fields[:1] == [dialect.edge]:
            if before_edges is None:
                before_edges, ending = len(out), text[len(text.rstrip(b"\r\n")) :]
            k = written.get(line)
            if k is None:
                continue
            if edges.weights[k] != edges.source.weights[k]:
                text = _reweighted(dialect, text, float(edges.weights[k]))
        elif fields[:1] == [FIX]:
            text = _fix_line(text, gone)
        elif line in of_gone:
            continue
        out.append(text)
    out[before_edges:before_edges] = [
        _vertex(dialect, *vertex).encode() + (ending or b"\n") for vertex in missing.items()
    ]
    return b"".join(out)


def _new_vertices(
    path: Path, source: PoseFile, solution: SolutionLike
) -> tuple[dict[int, Floats], int]:
    """Poses of all nodes in the file's gauge, and how many of their numbers are not new."""
    graph, dialect = solution.graph, source.dialect
    gauge = gauge_of(solution, dialect, source.vertices, source.fixed)
    refined = refined_positions(solution)
    if refined is not None:
        turned = turned_along(solution.rotations, gauge.rotations, refined)
        held = {row: (place, np.eye(3)) for row, place in gauge.known.items()}
        where: Floats | None = moved_to(graph, turned, held)
    else:
        where = _positions(path, solution, gauge.rotations, gauge.known)
        where = where if where is None else moved_to(graph, where, gauge.placed)
    kept = dialect.dimension if where is None else 0
    translations = np.zeros((graph.num_nodes, 3)) if where is None else where
    for row, place in gauge.known.items():
        translations[row] = place
    poses = _numbers(path, dialect, translations, gauge.rotations)
    return dict(zip(graph.nodes.tolist(), poses)), kept


def _positions(
    path: Path, solution: SolutionLike, rotations: Floats, known: dict[int, Floats]
) -> Floats | None:
    if solution.graph.translations is None:
        return None
    try:
        shares = robust_shares(solution)
        return positions(solution.graph, rotations, fixed=known, edge_shares=shares)
    except SolverError as error:
        warnings.warn(
            f"{path}: only the rotations are new; the translations do not fit them ({error})",
            IncompleteWarning,
            stacklevel=2,
        )
        return None


def _numbers(path: Path, dialect: Dialect, translations: Floats, rotations: Floats) -> Floats:
    poses = dialect.poses(translations, np.asarray(rotations, dtype=np.float64))
    if dialect.dimension == 2:
        tilt = float(np.arccos(np.clip(rotations[:, 2, 2], -1, 1)).max(initial=0.0))
        if tilt > _TILT_WORTH_A_WARNING:
            warnings.warn(
                f"{path}: poses in the plane cannot say that a node is tilted by "
                f"{np.degrees(tilt):.3g} deg: written is what it turns about z",
                IncompleteWarning,
                stacklevel=2,
            )
    return poses


def _isolated(dialect: Dialect, graph: MeasurementGraph) -> dict[int, Floats]:
    """A vertex for each node that no edge would tell of."""
    alone = np.ones(graph.num_nodes, dtype=np.bool_)
    alone[graph.indices] = False
    identity = dialect.poses(np.zeros((1, 3)), np.eye(3)[None])[0]
    return dict.fromkeys(graph.nodes[alone].tolist(), identity)


def _vertex(dialect: Dialect, node: int, pose: Floats) -> str:
    return f"{dialect.vertex.decode()} {node} {' '.join(map(_short, pose.tolist()))}"


def _edges(dialect: Dialect, graph: MeasurementGraph) -> bytes:
    m, moved = graph.num_edges, graph.translations
    vectors = np.zeros((m, 3)) if moved is None else moved.vectors
    certain = np.broadcast_to(np.eye(3), (m, 3, 3)) if moved is None else moved.information
    if dialect is G2O_3D:
        poses = np.hstack([vectors, graph.quaternions])
    else:
        poses = dialect.poses(vectors, graph.rotations)
    rotation = cross = None
    if graph.covariances is not None and dialect.dimension == 3:
        between = None if moved is None else moved.cross
        rotation, cross = information_to_write(graph.covariances, graph.weights, between)
    values = dialect.values(dialect.information(certain, graph.weights, rotation, cross))
    numbers = np.hstack([poses, values])
    return bulk.write_rows(graph.edges, numbers, tag=dialect.edge.decode(), short_zeros=True)


def _short(number: float) -> str:
    return "0" if number == 0 else repr(number)


def _priors_of(source: PoseFile, nodes: frozenset[int]) -> set[int]:
    """The lines of the priors of these nodes."""
    ids = {str(node).encode() for node in nodes}
    lines = source.pose_priors.entries if ids and source.pose_priors is not None else ()
    fields = ((line, text.split(None, 2)) for line, text in lines)
    return {line for line, words in fields if words[0][:4] == b"EDGE" and ids & set(words[1:2])}


def _fix_line(text: bytes, gone: frozenset[int]) -> bytes:
    content, _, _ = text.partition(b"#")
    ids = content.split()[1:]
    stay = [node for node in ids if int(node) not in gone]
    if len(stay) == len(ids):
        return text
    ending = text[len(text.rstrip(b"\r\n")) :]
    return b" ".join([FIX, *stay]) + ending if stay else b""


def _reweighted(dialect: Dialect, text: bytes, weight: float) -> bytes:
    """The edge line with D Omega D for its information, D = diag(1, ..., s, ...)."""
    content, comment, rest = text.rstrip().partition(b"#")
    fields = content.split()
    start = 3 + dialect.num_pose
    matrices = dialect.information(np.eye(3)[None], np.zeros(1))
    if fields[start:]:
        matrices = dialect.matrices(np.array(fields[start:], dtype=np.float64)[None])
    now = float(kappa(dialect.rotation_information(dialect.values(matrices)))[0])
    if now > 0:
        turned = np.arange(matrices.shape[1]) >= dialect.dimension
        scale = np.where(turned, np.sqrt(weight / now), 1.0)
        matrices = matrices * np.outer(scale, scale)
    else:  # it was read with unit weights: there is nothing to scale
        new = dialect.information(np.zeros((1, 3, 3)), np.array([weight]))
        d = dialect.dimension
        matrices[:, d:, d:] = new[:, d:, d:]
    values = exactly(dialect.values(matrices)[0])
    line = b" ".join([*fields[:start], *(number.encode() for number in values)])
    ending = text[len(text.rstrip()) :]
    return line + (b" " + comment + rest if comment else b"") + ending

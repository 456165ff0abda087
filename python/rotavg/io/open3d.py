"""Open3D's pose graphs, JSON (Choi, Zhou and Koltun 2015); pose family.

    {"class_name": "PoseGraph", "version_major": 1, "version_minor": 0,
     "nodes": [{"class_name": "PoseGraphNode", "pose": [16 numbers], ...}, ...],
     "edges": [{"class_name": "PoseGraphEdge", "source_node_id": s, "target_node_id": t,
                "transformation": [16], "information": [36], "uncertain": false, ...}, ...]}

Nodes are counted from 0, poses are world_from_node, matrices stand column by column. The
transformation is target_from_source: the edge is (i, j) = (t, s). Information has rotation first,
in the frame of s.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.covariances import information_to_write, symmetric
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import nearest_rotation
from rotavg.io.absolute import AbsoluteRotations, RotationReader
from rotavg.io.json_data import entries, member, numbers, parsed, whole
from rotavg.io.measured_poses import measured_poses
from rotavg.io.placed import positions_of
from rotavg.io.places import Places
from rotavg.io.registry import Format, ReadOptions, Writable, edges_to_write
from rotavg.io.rounding import matrix_notes

Floats = NDArray[np.float64]

_CLASS = re.compile(rb'"class_name"\s*:\s*"PoseGraph(Node|Edge)?"')
_TRANSLATION_FIRST = np.array([3, 4, 5, 0, 1, 2])


def read_open3d(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the edges. How far Open3D believed each of them (its `confidence`) is not used."""
    value = _pose_graph(path, data)
    count = len(entries(path, value.get("nodes"), "nodes"))
    edges = entries(path, value.get("edges"), "edges")
    if not edges:
        raise FormatError("the file has no edges: the list is empty", path=path)
    names = [f"edges[{k}]" for k in range(len(edges))]
    pairs = []
    poses, omega = np.empty((len(edges), 4, 4)), np.empty((len(edges), 6, 6))
    for k, (edge, where) in enumerate(zip(edges, names)):
        ends = []
        for end in ("target_node_id", "source_node_id"):
            node = whole(path, member(path, edge, end, where), f"{where}.{end}")
            if not 0 <= node < count:
                found = f"{where}.{end}: found {node}"
                raise FormatError(f"{found}, expected 0 to {count - 1}: the nodes", path=path)
            ends.append(node)
        pairs.append((ends[0], ends[1]))
        poses[k] = _matrix(path, edge, "transformation", 4, where)
        omega[k] = _matrix(path, edge, "information", 6, where)
    places = Places(names)
    rotations = poses[:, :3, :3]
    notes = matrix_notes(path, rotations, None)
    omega = omega[:, _TRANSLATION_FIRST[:, None], _TRANSLATION_FIRST]
    omega = symmetric(omega)
    if any(edge.get("confidence", 1) != 1 for edge in edges):
        notes += ("the confidence of edges is not read: see robust losses",)
    return measured_poses(
        path, places, pairs, rotations, poses[:, :3, 3], omega, options,
        nodes=np.arange(count), notes=notes,
    )  # fmt: skip


def read_open3d_rotations(path: Path, data: bytes) -> AbsoluteRotations:
    """Read the rotations of the nodes."""
    nodes = entries(path, _pose_graph(path, data).get("nodes"), "nodes")
    if not nodes:
        raise FormatError("the file has no nodes: the list is empty", path=path)
    poses = np.array(
        [_matrix(path, node, "pose", 4, f"nodes[{k}]") for k, node in enumerate(nodes)]
    )
    rotations = poses[:, :3, :3]
    notes = matrix_notes(path, rotations, None)
    return AbsoluteRotations(np.arange(len(nodes)), nearest_rotation(rotations), notes=notes)


def write_open3d(path: Path, item: Writable) -> bytes:
    """The content of a pose graph; without a solution its nodes are at the identity.

    Nodes keep their ids if these are 0 to n - 1; otherwise they are counted in their order. Edges
    between nodes that do not follow each other are uncertain, which is Open3D's own rule.
    """
    graph = item if isinstance(item, MeasurementGraph) else item.graph
    n = graph.num_nodes
    number = np.array(numbers_of(graph) or range(n))
    poses = np.tile(np.eye(4), (n, 1, 1))
    if not isinstance(item, MeasurementGraph):
        poses[:, :3, :3] = item.rotations
        where = positions_of(item)
        if where is not None:
            poses[:, :3, 3] = where
    nodes: list[Any] = [None] * n
    for node, pose in zip(number.tolist(), poses):
        nodes[node] = {**_header("PoseGraphNode"), "pose": _columns(pose)}
    graph = edges_to_write(item)
    relative = np.tile(np.eye(4), (graph.num_edges, 1, 1))
    relative[:, :3, :3] = graph.rotations
    if graph.translations is not None:
        relative[:, :3, 3] = graph.translations.vectors
    ends = number[graph.indices].tolist()
    edges = [
        {
            **_header("PoseGraphEdge"),
            "source_node_id": j,
            "target_node_id": i,
            "uncertain": abs(i - j) != 1,
            "confidence": 1.0,
            "transformation": _columns(pose),
            "information": _columns(omega),
        }
        for (i, j), pose, omega in zip(ends, relative, _information(graph))
    ]
    return json.dumps({**_header("PoseGraph"), "nodes": nodes, "edges": edges}).encode()


def numbers_of(graph: MeasurementGraph) -> list[int] | None:
    """The ids of the nodes, if they are 0 to n - 1; None otherwise."""
    ids = graph.nodes.tolist()
    return ids if graph.nodes.dtype.kind == "i" and sorted(ids) == list(range(len(ids))) else None


def _information(graph: MeasurementGraph) -> Floats:
    """(m, 6, 6), rotation first, of which a reader makes the graph's weights."""
    omega = np.tile(np.eye(6), (graph.num_edges, 1, 1))
    omega[:, :3, :3] *= 2 * graph.weights[:, None, None]
    moved = graph.translations
    cross = None if moved is None else moved.cross
    if graph.covariances is not None:
        omega[:, :3, :3], cross = information_to_write(graph.covariances, graph.weights, cross)
    if moved is not None:
        omega[:, 3:, 3:] = moved.information
    if cross is not None:
        omega[:, 3:, :3] = cross
        omega[:, :3, 3:] = np.swapaxes(cross, 1, 2)
    return omega


def _pose_graph(path: Path, data: bytes) -> dict[str, Any]:
    value = parsed(path, data)
    if value.get("class_name") != "PoseGraph":
        found = f"found the class_name {value.get('class_name')!r}"
        raise FormatError(f'{found}, expected "PoseGraph", as Open3D writes it', path=path)
    return value


def _matrix(path: Path, value: Any, name: str, size: int, where: str) -> Floats:
    flat = numbers(path, member(path, value, name, where), size * size, f"{where}.{name}")
    return flat.reshape(size, size).T


def _columns(matrix: Floats) -> list[float]:
    return [float(number) + 0.0 for number in matrix.T.ravel()]


def _header(name: str) -> dict[str, Any]:
    return {"class_name": name, "version_major": 1, "version_minor": 0}


OPEN3D = Format(
    name="open3d",
    suffixes=(".json",),
    recognises=lambda head: _CLASS.search(head) is not None,
    read=read_open3d,
    write=write_open3d,
    has_ids=lambda graph: numbers_of(graph) is not None,
    has_translations=True,
    has_covariances=True,
    rotations=RotationReader(
        (), read_open3d_rotations, lambda head: _CLASS.search(head) is not None, (".json",)
    ),
    has_positions=True,
)

"""Readers of what stands beside a graph: gravity, rigs, lists of edges and nodes, positions."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from rotavg.cli.known_edges import KnownEdges, read_known_edges
from rotavg.io.node_list import read_node_list
from rotavg.io.positions import positions
from tests.fuzz.good_files import UPPER3, text

_PAIRS = np.array([(0, 1), (1, 2), (2, 3), (0, 3)])
_NAMES = np.array(["left/0.jpg", "right/0.jpg", "left/1.jpg", "right/1.jpg"])
_RIGS = (
    "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
    "CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY, ref_sensor_id INTEGER,"
    " ref_sensor_type INTEGER);"
    "CREATE TABLE rig_sensors (rig_id INTEGER, sensor_id INTEGER, sensor_type INTEGER,"
    " sensor_from_rig BLOB);"
    "CREATE TABLE frames (frame_id INTEGER PRIMARY KEY, rig_id INTEGER);"
    "CREATE TABLE frame_data (frame_id INTEGER, data_id INTEGER, sensor_id INTEGER,"
    " sensor_type INTEGER);"
    "CREATE TABLE pose_priors (corr_data_id INTEGER, corr_sensor_type INTEGER, gravity BLOB);"
)


def _graph(how: int) -> rotavg.MeasurementGraph:
    """Four nodes in a ring, by names or by numbers."""
    edges = _NAMES[_PAIRS] if how % 2 else _PAIRS
    return rotavg.MeasurementGraph(edges, np.tile(np.eye(3), (4, 1, 1)))


def _gravity(path: Path, how: int) -> None:
    names, vectors = rotavg.io.read_gravity(path)
    assert vectors.shape == (len(names), 3)
    assert np.isfinite(vectors).all()
    assert vectors.any(axis=1).all()


def _rigs(path: Path, how: int) -> None:
    graph = _graph(how)
    rigs = rotavg.io.read_rigs(path, graph)
    assert set(rigs.images) <= set(graph.nodes.tolist())
    for R in rigs.rotations.values():
        assert np.abs(np.asarray(R).T @ R - np.eye(3)).max() < 1e-9


def _edges(path: Path, how: int) -> None:
    graph = _graph(how // 3)
    known = KnownEdges(None, False, path) if how % 3 else KnownEdges(path, False, None)
    for mask in read_known_edges(graph, known).values():
        assert mask is None or mask.shape == (graph.num_edges,)


def _nodes(path: Path, how: int) -> None:
    nodes = read_node_list(path)
    assert nodes.dtype.kind in "iuU"
    assert len(set(nodes.tolist())) == len(nodes) > 0


def _positions(path: Path, how: int) -> None:
    graph = rotavg.read(path, skip_self_edges=how % 2 == 0)
    where = positions(graph)
    assert where is None or (where.shape == (graph.num_nodes, 3) and np.isfinite(where).all())


def _rig_database(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.executescript(_RIGS)
    connection.execute("INSERT INTO rigs VALUES (1, 1, 0)")
    pose = np.array([0.6, 0.8, 0.0, 0.0, 1.0, 2.0, 3.0]).tobytes()
    connection.execute("INSERT INTO rig_sensors VALUES (1, 2, 0, ?)", (pose,))
    for k, name in enumerate(_NAMES.tolist()):
        frame, sensor = k // 2 + 1, k % 2 + 1
        connection.execute("INSERT INTO images VALUES (?, ?, ?)", (k + 1, name, sensor))
        connection.execute("INSERT OR IGNORE INTO frames VALUES (?, 1)", (frame,))
        connection.execute("INSERT INTO frame_data VALUES (?, ?, ?, 0)", (frame, k + 1, sensor))
        down = np.array([0.0, 1.0, 0.1 * k]).tobytes()
        connection.execute("INSERT INTO pose_priors VALUES (?, 0, ?)", (k + 1, down))
    connection.commit()
    connection.close()


@dataclass(frozen=True)
class Beside:
    """A reader, which is given a number that says how to call it, and good files by their names."""

    read: Callable[[Path, int], None]
    files: dict[str, Callable[[Path], Any]]


_TABLE = "".join(
    f"{name},{k // 2},{name[0]},{q}\n"
    for k, name in enumerate(_NAMES.tolist())
    for q in [("1,0,0,0", "0.6,0.8,0,0")[k % 2]]
)
BESIDE = {
    "gravity": Beside(
        _gravity,
        {
            "gravity.txt": text("# name gx gy gz\na.jpg 0 1 0\nb.jpg 0.1 0.9 -0.2\n"),
            "gravity.db": _rig_database,
        },
    ),
    "rigs": Beside(
        _rigs,
        {
            "rig_config.json": text(
                '[{"cameras": [{"image_prefix": "left/", "ref_sensor": true}, {"image_prefix": '
                '"right/", "cam_from_rig_rotation": [0.6, 0.8, 0, 0]}]}]'
            ),
            "names.csv": text("node,frame,sensor,qw,qx,qy,qz\n" + _TABLE),
            "numbers.csv": text("node,frame,sensor\n0,a,l\n1,a,r\n2,b,l\n3,b,r\n"),
            "rigs.db": _rig_database,
        },
    ),
    "edges": Beside(
        _edges,
        {
            "numbers.txt": text("0 1\n2 1\n# a comment\n0 3\n"),
            "names.txt": text("left/0.jpg right/0.jpg\nleft/0.jpg right/1.jpg\n"),
            "table.csv": text('i,j,trusted,excluded\n0,1,1,0\n1,2,0,yes\n"2",3,true,no\n'),
        },
    ),
    "nodes": Beside(
        _nodes, {"numbers.txt": text("3\n1\n\n2\n1\n"), "names.txt": text("a b.jpg\nc.jpg\n")}
    ),
    "positions": Beside(
        _positions,
        {
            "g.g2o": text(
                "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0.5 0 0 0.6 0.8\n"
                "VERTEX_SE3:QUAT 2 2 1e3 -1 0 0 0 1\n"
                + "".join(
                    f"EDGE_SE3:QUAT {i} {j} 1 0 0 0 0 0 1 {UPPER3}\n"
                    for i, j in ((0, 1), (1, 2), (0, 2))
                )
            )
        },
    ),
}


def good_files_beside(folder: Path, name: str) -> list[Path]:
    """The good files of one of these readers, written to a folder."""
    found = []
    for file, write in BESIDE[name].files.items():
        path = folder / name / str(len(found)) / file
        path.parent.mkdir(parents=True)
        write(path)
        found.append(path)
    return found

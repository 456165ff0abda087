"""A few small files of every format that is read, to be spoilt."""

from __future__ import annotations

import json
import sqlite3
import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from rotavg.io import FORMATS


def good_files(folder: Path) -> dict[str, list[Path]]:
    """Small files of every format that is read, by its name."""
    found: dict[str, list[Path]] = {}
    simulation = rotavg.simulate("sphere", 9, noise=0.05, seed=1)
    graph = simulation.graph
    plain = rotavg.MeasurementGraph(
        graph.edges, graph.rotations, np.linspace(1, 2, graph.num_edges)
    )
    solution = rotavg.solve(graph)
    for form in FORMATS:
        paths = []
        usual = form.suffixes[0] if form.suffixes else ".dat"
        name = f"graph{usual}" if usual.startswith(".") else usual.replace("*", "g")
        if form.name == "text":
            path = folder / form.name / "v" / name
            path.parent.mkdir(parents=True)
            path.write_text("i j rx ry rz weight\n0 1 0.1 0 0 1\n1 2 0 0.2 0 1\n0 2 0 0 0.3 2\n")
            paths.append(path)
        for kind, item in (("a", graph), ("b", plain), ("s", solution)):
            is_solution = kind == "s"
            if form.write is None or not (form.has_solutions if is_solution else form.has_graphs):
                continue
            if form.name == "colmap_model":
                continue  # it is made of a database, and read as images.txt
            path = folder / form.name / kind / name.lower()
            if form.main_file:
                path = path.parent / form.main_file
            path.parent.mkdir(parents=True)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                rotavg.write(path, item, format=form.name)
            if form.name == "g2o" and kind == "a":
                path.write_text(path.read_text() + _PRIORS)
            paths.append(path)
        if form.name in _BY_HAND:
            path = folder / form.name / "h" / name
            path.parent.mkdir(parents=True)
            _BY_HAND[form.name](path)
            paths.append(path)
        found[form.name] = paths
    return found


def text(content: str) -> Callable[[Path], Any]:
    """What writes this to a file."""
    return lambda path: path.write_text(content)


UPPER3 = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"
_PRIORS = (
    "PARAMS_SE3OFFSET 0 0 0 0 0 0 0.6 0.8\n"
    f"EDGE_SE3_PRIOR 1 0 1 2 3 0 0 0 1 {UPPER3}\nEDGE_SE3_XYZ_PRIOR 1 0 1 2 3 1 0 0 1 0 1\n"
)


def _database(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.executescript(
        "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
        "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER,"
        " height INTEGER, params BLOB, prior_focal_length INTEGER);"
        "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER,"
        " data BLOB, config INTEGER, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);"
    )
    for k in range(1, 5):
        connection.execute("INSERT INTO images VALUES (?, ?, 1)", (k, f"im{k}.jpg"))
    rng = np.random.default_rng(0)
    for i, j in ((1, 2), (2, 3), (3, 4), (1, 4)):
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        t = rng.normal(size=3)
        inliers = np.zeros((20, 2), dtype=np.uint32).tobytes()
        connection.execute(
            "INSERT INTO two_view_geometries VALUES (?, 20, 2, ?, 2, NULL, NULL, NULL, ?, ?)",
            (2147483647 * i + j, inliers, q.tobytes(), t.tobytes()),
        )
    connection.commit()
    connection.close()


def _images(path: Path) -> None:
    content = struct.pack("<Q", 3)
    for k in range(1, 4):
        content += struct.pack("<I7dI", k, 0.6, 0.0, 0.8, 0.0, 1.0, 2.0, 3.0, 1) + b"im%d.jpg\0" % k
        content += struct.pack("<Q", k) + struct.pack("<2dQ", 1.0, 2.0, 7) * k
    path.write_bytes(content)


_POSE3 = '{"type": "Pose3", "translation": [1, 2, 3], "rotation": [1, 0, 0, 0]}'
_COVARIANCE = json.dumps(np.eye(6).ravel().tolist())
_BY_HAND: dict[str, Callable[[Path], Any]] = {
    "g2o": text(
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.1\nFIX 0\nEDGE_SE2 0 1 1 0 0.1 1 0 0 1 0 4\n"
        "EDGE_SE2 1 2 1 0 0.1 1 0 0.1 1 0 4\n# a comment\nEDGE_SE2 2 0 1 0 0.1 1 0 0 1 0 4\n"
        "EDGE_PRIOR_SE2 1 1 2 0.1 1 0 0 1 0 4\nEDGE_PRIOR_SE2_XY 2 1 2 1 0 1\n"
    ),
    "toro": text(
        f"VERTEX3 0 0 0 0 0 0 0\nEDGE3 0 1 1 0 0 0 0 0.1 {UPPER3}\n"
        f"EDGE3 1 2 1 0 0 0 0 0 {UPPER3}\n"
        f"EDGE3 0 2 1 0 0 0 0 0.1 {UPPER3}\n"
    ),
    "pyfg": text(
        "VERTEX_SE3:QUAT 0.0 A0 0 0 0 0 0 0 1\nVERTEX_XYZ L0 1 2 3\n"
        f"EDGE_SE3:QUAT 0.5 A0 A1 1 0 0 0 0 0 1 {UPPER3}\nEDGE_RANGE 0.5 A0 L0 1 0.1\n"
        f"EDGE_SE3:QUAT 0.5 A1 A2 1 0 0 0 0 0 1 {UPPER3}\n"
        f"EDGE_SE3:QUAT 1 A0 A2 1 0 0 0 0 0 1 {UPPER3}\n"
        f"VERTEX_SE3:QUAT:PRIOR 1 A2 1 0 0 0 0 0 1 {UPPER3}\n"
    ),
    "jrl": text(
        '{"name": "n", "robots": ["a"], "measurements": {"a": [{"stamp": 0, "measurements": ['
        + ", ".join(
            f'{{"type": "BetweenFactorPose3", "key1": {i}, "key2": {j}, "measurement": {_POSE3}, '
            f'"covariance": {_COVARIANCE}}}'
            for i, j in ((0, 1), (1, 2), (0, 2))
        )
        + '], "x": 1}, {"stamp": 1, "measurements": [{"type": "PriorFactorPose3", "key": 0, '
        f'"prior": {_POSE3}, "covariance": {_COVARIANCE}}}]}}]}}}}'
    ),
    "csv": text(
        "name1;name2;weight;qw;qx;qy;qz;note\na;b;1;1,0;0;0;0;x\nb;c;2;0,6;0,8;0;0;\na;c;1;1;0;0;0;\n"
    ),
    "text": text(
        "# from to r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 1 1 0 0 0 1 0 0 0 1\n"
        "1 2 0 -1 0 1 0 0 0 0 1\n2 0 1 0 0 0 1 0 0 0 1\n"
    ),
    "tum": text("# timestamp x y z qx qy qz qw\n0.5 1 2 3 0 0 0 1\n1.5 1 2 3 0 0 0.6 0.8\n"),
    "colmap": _database,
    "colmap_binary": _images,
}

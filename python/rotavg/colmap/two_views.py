"""The relative rotations in a COLMAP database: from there to a graph, and back from a solution."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.conventions import convert_family, quaternions_from_matrices, wxyz_from_xyzw
from rotavg.errors import FileAccessError, FormatError, require
from rotavg.graph import MeasurementGraph
from rotavg.io.atomic import new_file
from rotavg.io.registry import SolutionLike

_ID_FACTOR = 2147483647  # pair_id = factor * smaller image id + larger image id
# Configurations without a relative rotation: undefined, degenerate, watermark, several at once.
_WITHOUT_ROTATION = (0, 1, 7, 8)
_MIN_INLIERS = 15


def read_graph(database: str | os.PathLike[str]) -> MeasurementGraph:
    """The graph of a database's two-view geometries; image names are nodes, inliers are weights.

    Pairs with a relative rotation and at least 15 inliers count. The file is opened read-only.
    Raises FileAccessError or FormatError.
    """
    with reading(Path(database)) as connection:
        return graph_of(connection, Path(database))


def graph_of(connection: sqlite3.Connection, path: Path) -> MeasurementGraph:
    """What `read_graph` reads, of an open database; `path` is named in errors."""
    names = dict(connection.execute("SELECT image_id, name FROM images"))
    rows = connection.execute(
        "SELECT pair_id, rows, config, qvec FROM two_view_geometries "
        "WHERE qvec IS NOT NULL AND rows >= ? ORDER BY pair_id",
        (_MIN_INLIERS,),
    ).fetchall()
    rows = [row for row in rows if row[2] not in _WITHOUT_ROTATION]
    if not rows:
        expected = f"expected two-view geometries with a pose and {_MIN_INLIERS} inliers or more"
        raise FormatError(f"found no relative rotations, {expected}", path=path)
    edges = []
    for pair_id, *_ in rows:
        ids = divmod(pair_id, _ID_FACTOR)
        if not all(image in names for image in ids):
            found = f"found a pair of the images {ids[0]} and {ids[1]}"
            raise FormatError(f"{found}, expected both among the images", path=path)
        edges.append([str(names[image]) for image in ids])
    if any(len(qvec) != 32 for *_, qvec in rows):
        raise FormatError("found a qvec that is not four doubles", path=path)
    qvecs = [np.frombuffer(qvec) for *_, qvec in rows]
    return MeasurementGraph.from_quaternions(
        edges,
        qvecs,
        weights=[inliers for _, inliers, *_ in rows],
        order="wxyz",
        convention="vision",
    )


def write_rotations(
    database: str | os.PathLike[str],
    solution: SolutionLike,
    output: str | os.PathLike[str],
    *,
    max_residual: float = np.radians(10.0),
) -> int:
    """Copy a database; in the copy the relative rotations are those of the solution, consistent.

    Pairs that the solution contradicts by more than `max_residual` (radians), and those with an
    image that it does not know, lose their two-view geometry. Relative translations stay as they
    are: directions in the second image's frame.

    Returns the number of pairs that were contradicted. Raises FileAccessError if `output` is there
    already, FormatError if `database` is not one of COLMAP's.
    """
    camera_from_world = convert_family(np.asarray(solution.rotations, dtype=np.float64), "vision")
    row = {name: k for k, name in enumerate(solution.graph.nodes.tolist())}
    dropped = 0
    with new_file(Path(output)) as temporary:
        copy_database(Path(database), temporary)
        with closing(sqlite3.connect(temporary)) as copy:
            names = dict(copy.execute("SELECT image_id, name FROM images"))
            pairs = copy.execute("SELECT pair_id, qvec FROM two_view_geometries").fetchall()
            for pair_id, measured in pairs:
                first, second = (row.get(names.get(k)) for k in divmod(pair_id, _ID_FACTOR))
                if measured is not None and first is not None and second is not None:
                    R = camera_from_world[second] @ camera_from_world[first].T
                    q = wxyz_from_xyzw(quaternions_from_matrices(R))
                    if _angle_between(q, np.frombuffer(measured)) <= max_residual:
                        copy.execute(
                            "UPDATE two_view_geometries SET qvec = ? WHERE pair_id = ?",
                            (q.tobytes(), pair_id),
                        )
                        continue
                    dropped += 1
                copy.execute("DELETE FROM two_view_geometries WHERE pair_id = ?", (pair_id,))
            copy.commit()
    return dropped


def copy_database(database: Path, output: Path) -> None:
    """Copy a database, what its log holds included; the original is opened read-only."""
    with reading(database) as source, closing(sqlite3.connect(output)) as copy:
        source.backup(copy)


def complete_poses(database: Path) -> int:
    """Compute, in place, the relative poses that COLMAP left out; returns how many (pycolmap)."""
    pycolmap = require("pycolmap", "colmap")
    opened = pycolmap.Database.open(database)
    cameras = {camera.camera_id: camera for camera in opened.read_all_cameras()}
    images = {image.image_id: image for image in opened.read_all_images()}
    completed = 0
    for pair_id, geometry in zip(*opened.read_two_view_geometries()):
        if geometry.cam2_from_cam1 is not None or int(geometry.config) in _WITHOUT_ROTATION:
            continue
        ids = divmod(pair_id, _ID_FACTOR)
        arguments = []
        for image_id in ids:
            points = opened.read_keypoints(image_id)[:, :2].astype(np.float64)
            arguments += [cameras[images[image_id].camera_id], points]
        if pycolmap.estimate_two_view_geometry_pose(*arguments, geometry):
            opened.update_two_view_geometry(*ids, geometry)
            completed += 1
    opened.close()
    return completed


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A COLMAP database opened read-only; what SQLite finds wrong is an error about the file."""
    if not path.is_file():
        raise FileAccessError("cannot be read: there is no such file", path=path)
    # With nothing in its log, SQLite need not lay a log of its own beside somebody's file.
    logs = [path.with_name(path.name + suffix) for suffix in ("-wal", "-journal")]
    mode = "mode=ro" if any(log.exists() for log in logs) else "immutable=1"
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)) as opened:
            for table in ("images", "two_view_geometries"):
                opened.execute(f"SELECT 1 FROM {table} LIMIT 1")
            yield opened
    except sqlite3.Error as error:
        raise FormatError(f"found no COLMAP database: {error}", path=path) from error


def _angle_between(q1: NDArray[np.float64], q2: NDArray[np.float64]) -> float:
    """Angle between two rotations, radians, from quaternions (4,) in any one order."""
    cosine = abs(float(q1 @ q2)) / float(np.linalg.norm(q1) * np.linalg.norm(q2))
    return float(2 * np.arccos(min(1.0, cosine)))

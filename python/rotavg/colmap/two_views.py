"""The relative rotations in a copy of a COLMAP database: computed, and those of a solution."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.colmap.new_database import new_database, writing
from rotavg.graph.conventions import convert_family, quaternions_from_matrices, wxyz_from_xyzw
from rotavg.io.colmap_sqlite import opened, pair_of
from rotavg.io.registry import SolutionLike

# Configurations without a relative rotation: undefined, degenerate, watermark, several at once.
_WITHOUT_ROTATION = (0, 1, 7, 8)


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
    already or cannot be written, FormatError if `database` is not one of COLMAP's.
    """
    camera_from_world = convert_family(np.asarray(solution.rotations, dtype=np.float64), "vision")
    row = {name: k for k, name in enumerate(solution.graph.nodes.tolist())}
    dropped = 0
    with new_database(Path(output)) as temporary:
        copy_database(Path(database), temporary)
        with closing(sqlite3.connect(temporary)) as copy:
            names = dict(copy.execute("SELECT image_id, name FROM images"))
            pairs = copy.execute("SELECT pair_id, qvec FROM two_view_geometries").fetchall()
            for pair_id, measured in pairs:
                first, second = (row.get(names.get(k)) for k in pair_of(pair_id))
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
    """Copy a database, what its log holds included; the original is opened read-only.

    Raises FormatError if it is none of COLMAP's, FileAccessError if the copy cannot be written.
    """
    with opened(database) as source, closing(sqlite3.connect(output)) as copy:
        for table in ("images", "two_view_geometries"):  # or it is no database of COLMAP's
            source.execute(f"SELECT 1 FROM {table} LIMIT 1")
        with writing(output):
            source.backup(copy)


def complete_poses(database: Path) -> int:
    """Compute, in place, the relative poses that COLMAP left out; returns how many (pycolmap)."""
    pycolmap = require("pycolmap", "colmap")
    copy = pycolmap.Database.open(database)
    cameras = {camera.camera_id: camera for camera in copy.read_all_cameras()}
    images = {image.image_id: image for image in copy.read_all_images()}
    completed = 0
    for pair_id, geometry in zip(*copy.read_two_view_geometries()):
        if geometry.cam2_from_cam1 is not None or int(geometry.config) in _WITHOUT_ROTATION:
            continue
        ids = pair_of(pair_id)
        arguments = []
        for image_id in ids:
            points = copy.read_keypoints(image_id)[:, :2].astype(np.float64)
            arguments += [cameras[images[image_id].camera_id], points]
        if pycolmap.estimate_two_view_geometry_pose(*arguments, geometry):
            copy.update_two_view_geometry(*ids, geometry)
            completed += 1
    copy.close()
    return completed


def _angle_between(q1: NDArray[np.float64], q2: NDArray[np.float64]) -> float:
    """Angle between two rotations, radians, from quaternions (4,) in any one order."""
    cosine = abs(float(q1 @ q2)) / float(np.linalg.norm(q1) * np.linalg.norm(q2))
    return float(2 * np.arccos(min(1.0, cosine)))

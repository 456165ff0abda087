"""Relative poses that COLMAP left out of its database, from what it did store of the pairs.

That is the essential or fundamental matrix or the homography, the inliers and the cameras, which
pycolmap (the extra [colmap]) turns into a pose as COLMAP itself does. The database is only read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import MissingExtraError, require

if TYPE_CHECKING:
    import sqlite3

_UNCALIBRATED = 3
# What COLMAP takes the pose from, by configuration.
_MATRIX_OF = {2: "E", 3: "F", 4: "H", 5: "H", 6: "H", 9: "E"}


def poses_of_pairs(
    connection: sqlite3.Connection, pairs: Sequence[tuple[int, int, int]]
) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] | None:
    """Camera 2 from camera 1, wxyz and translation, of pairs (pair_id, image_id, image_id).

    Pairs that say too little of their pose are not in it; None where pycolmap is not installed.
    """
    try:
        pycolmap = require("pycolmap", "colmap")
    except MissingExtraError:
        return None
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if not {"cameras", "keypoints"} <= tables:
        return {}
    cameras = cameras_of(pycolmap, connection)
    points: dict[int, NDArray[np.float64]] = {}
    found = {}
    for pair_id, first, second in pairs:
        for image in (first, second):
            if image not in points:
                points[image] = keypoints_of(connection, image)
        geometry = _geometry(pycolmap, connection, pair_id, len(points[first]), len(points[second]))
        if geometry is None or first not in cameras or second not in cameras:
            continue
        sides = cameras[first], points[first], cameras[second], points[second]
        if pycolmap.estimate_two_view_geometry_pose(*sides, geometry):
            xyzw = geometry.cam2_from_cam1.rotation.quat
            if np.isfinite(xyzw).all() and np.any(xyzw):
                translation = np.array(geometry.cam2_from_cam1.translation)
                found[pair_id] = np.roll(xyzw, 1), translation
    return found


def cameras_of(pycolmap: Any, connection: sqlite3.Connection) -> dict[int, Any]:
    """The camera of every image, by image; those whose model pycolmap does not know are not in."""
    rows = connection.execute(
        "SELECT image_id, model, width, height, params FROM images "
        "JOIN cameras ON images.camera_id = cameras.camera_id"
    )
    found = {}
    for image, model, width, height, params in rows:
        whole = all(isinstance(value, int) and 0 <= value < 2**31 for value in (width, height))
        if not whole or not isinstance(params, bytes) or len(params) % 8:
            continue
        values = np.frombuffer(params, dtype="<f8")
        try:
            kind = pycolmap.CameraModelId(model)
            camera = pycolmap.Camera(model=kind, width=width, height=height, params=values)
            good = camera.verify_params() and np.isfinite(values).all()
        except (ValueError, TypeError):  # no model that it knows
            continue
        if good:
            found[image] = camera
    return found


def keypoints_of(connection: sqlite3.Connection, image: int) -> NDArray[np.float64]:
    """Where (k, 2) the features of an image are."""
    row = connection.execute(
        "SELECT rows, cols, data FROM keypoints WHERE image_id = ?", (image,)
    ).fetchone()
    if row is None or not all(isinstance(value, int) and value > 0 for value in row[:2]):
        return np.empty((0, 2))
    if not isinstance(row[2], bytes) or row[1] < 2 or len(row[2]) != 4 * row[0] * row[1]:
        return np.empty((0, 2))
    table = np.frombuffer(row[2], dtype="<f4").reshape(row[0], row[1])
    return np.ascontiguousarray(table[:, :2], dtype=np.float64)


def inliers_of(
    connection: sqlite3.Connection, pair_id: int, size_1: int, size_2: int
) -> NDArray[np.uint32]:
    """Rows (k, 2) of the features of a pair's images that match; none where they are not all there.

    Args:
        connection: to the database.
        pair_id: of the pair.
        size_1: how many features the first image has.
        size_2: the same of the second.
    """
    row = connection.execute(
        "SELECT data FROM two_view_geometries WHERE pair_id = ?", (pair_id,)
    ).fetchone()
    data = None if row is None else row[0]
    nothing = np.empty((0, 2), dtype=np.uint32)
    if not isinstance(data, bytes) or not data or len(data) % 8:
        return nothing
    matches = np.frombuffer(data, dtype="<u4").reshape(-1, 2)
    return nothing if (matches.max(axis=0) >= (size_1, size_2)).any() else matches


def _geometry(
    pycolmap: Any, connection: sqlite3.Connection, pair_id: int, size_1: int, size_2: int
) -> Any:
    """A pair's two-view geometry without its pose; None where it is not all there."""
    kind, *matrices = connection.execute(
        "SELECT config, F, E, H FROM two_view_geometries WHERE pair_id = ?", (pair_id,)
    ).fetchone()
    matches = inliers_of(connection, pair_id, size_1, size_2)
    if not len(matches):
        return None
    known = {}
    for name, blob in zip("FEH", matrices):
        if isinstance(blob, bytes) and len(blob) == 72:
            matrix = np.frombuffer(blob, dtype="<f8").reshape(3, 3)
            if np.isfinite(matrix).all() and matrix.any():
                known[name] = matrix
    if _MATRIX_OF[kind] == "E" and "E" not in known:
        kind = _UNCALIBRATED  # with F and the cameras it is as good
    if _MATRIX_OF[kind] not in known:
        return None
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = pycolmap.TwoViewGeometryConfiguration(kind)
    geometry.inlier_matches = matches
    for name, matrix in known.items():
        setattr(geometry, name, matrix)
    return geometry

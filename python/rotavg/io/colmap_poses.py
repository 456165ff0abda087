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


def quaternions_of_pairs(
    connection: sqlite3.Connection, pairs: Sequence[tuple[int, int, int]]
) -> dict[int, NDArray[np.float64]] | None:
    """The rotation wxyz of camera 2 from camera 1 of pairs (pair_id, image_id, image_id), by pair.

    Pairs that say too little of their pose are not in it; None where pycolmap is not installed.
    """
    try:
        pycolmap = require("pycolmap", "colmap")
    except MissingExtraError:
        return None
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if not {"cameras", "keypoints"} <= tables:
        return {}
    cameras = _cameras(pycolmap, connection)
    points: dict[int, NDArray[np.float64]] = {}
    found = {}
    for pair_id, first, second in pairs:
        for image in (first, second):
            if image not in points:
                points[image] = _keypoints(connection, image)
        geometry = _geometry(pycolmap, connection, pair_id, len(points[first]), len(points[second]))
        if geometry is None or first not in cameras or second not in cameras:
            continue
        sides = cameras[first], points[first], cameras[second], points[second]
        if pycolmap.estimate_two_view_geometry_pose(*sides, geometry):
            xyzw = geometry.cam2_from_cam1.rotation.quat
            if np.isfinite(xyzw).all() and np.any(xyzw):
                found[pair_id] = np.roll(xyzw, 1)
    return found


def _cameras(pycolmap: Any, connection: sqlite3.Connection) -> dict[int, Any]:
    """The camera of every image, by image; those whose model pycolmap does not know are not in."""
    rows = connection.execute(
        "SELECT image_id, model, width, height, params FROM images "
        "JOIN cameras ON images.camera_id = cameras.camera_id"
    )
    found = {}
    for image, model, width, height, params in rows:
        try:
            found[image] = pycolmap.Camera(
                model=pycolmap.CameraModelId(model),
                width=width,
                height=height,
                params=np.frombuffer(params or b"", dtype="<f8"),
            )
        except (ValueError, TypeError):
            continue
    return {image: camera for image, camera in found.items() if camera.verify_params()}


def _keypoints(connection: sqlite3.Connection, image: int) -> NDArray[np.float64]:
    """Where (k, 2) the features of an image are."""
    row = connection.execute(
        "SELECT rows, cols, data FROM keypoints WHERE image_id = ?", (image,)
    ).fetchone()
    if row is None or not row[2] or row[1] < 2 or len(row[2]) != 4 * row[0] * row[1]:
        return np.empty((0, 2))
    table = np.frombuffer(row[2], dtype="<f4").reshape(row[0], row[1])
    return np.ascontiguousarray(table[:, :2], dtype=np.float64)


def _geometry(
    pycolmap: Any, connection: sqlite3.Connection, pair_id: int, size_1: int, size_2: int
) -> Any:
    """A pair's two-view geometry without its pose; None where it is not all there."""
    data, kind, *matrices = connection.execute(
        "SELECT data, config, F, E, H FROM two_view_geometries WHERE pair_id = ?", (pair_id,)
    ).fetchone()
    if not data or len(data) % 8:
        return None
    matches = np.frombuffer(data, dtype="<u4").reshape(-1, 2)
    if (matches.max(axis=0) >= (size_1, size_2)).any():
        return None
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = pycolmap.TwoViewGeometryConfiguration(kind)
    geometry.inlier_matches = matches
    for name, blob in zip("FEH", matrices):
        if blob and len(blob) == 72:
            setattr(geometry, name, np.frombuffer(blob, dtype="<f8").reshape(3, 3))
    return geometry

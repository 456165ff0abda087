"""What COLMAP's database knows beside the pairs: gravity of the images, rigs of cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.conventions import convert_family, matrices_from_quaternions, xyzw_from_wxyz
from rotavg.io.colmap_sqlite import doubles, opened
from rotavg.io.rounding import is_unit
from rotavg.priors.priors import Rigs

if TYPE_CHECKING:
    import sqlite3


def read_gravity_of(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """Names of the images with a gravity prior, and it (k, 3), in the camera's frame."""
    with opened(path) as connection:
        rows = connection.execute(
            "SELECT name, gravity FROM pose_priors JOIN images ON corr_data_id = image_id "
            "WHERE corr_sensor_type = 0 AND gravity IS NOT NULL ORDER BY image_id"
        ).fetchall()
    vectors = [doubles(path, name, blob, 3) for name, blob in rows]
    known = [k for k, vector in enumerate(vectors) if np.isfinite(vector).all()]
    for k in known:
        if not vectors[k].any():
            found = f"pose_priors: the gravity of {rows[k][0]!r} is zero, expected a direction"
            raise FormatError(found, path=path)
    directions = np.array([vectors[k] for k in known]).reshape(-1, 3)
    return [rows[k][0] for k in known], directions


def count_gravity(connection: sqlite3.Connection) -> int:
    """Of how many images gravity is known."""
    columns = connection.execute("PRAGMA table_info(pose_priors)").fetchall()
    if not {"gravity", "corr_sensor_type"} <= {name for _, name, *_ in columns}:
        return 0
    rows = connection.execute(
        "SELECT gravity FROM pose_priors WHERE corr_sensor_type = 0 AND gravity IS NOT NULL"
    )
    return sum(
        isinstance(blob, bytes) and len(blob) == 24 and bool(np.isfinite(np.frombuffer(blob)).all())
        for (blob,) in rows
    )


def read_rigs_of(path: Path) -> Rigs | None:
    """The rigs of several cameras, nodes by the images' names; None where there are none."""
    with opened(path) as connection:
        return rigs_in(path, connection)


def sensor_from_rig_in(
    path: Path, rig: int, sensor: int, blob: bytes | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """R (3, 3) and t (3,) of a sensor; None where there is no rotation."""
    if blob is None:
        return None
    pose = doubles(path, f"sensor {sensor} of rig {rig}", blob, 7)
    if not is_unit(pose[:4]):  # NaN where COLMAP itself does not know it
        return None
    return matrices_from_quaternions(xyzw_from_wxyz(pose[:4])), pose[4:]


def rigs_in(path: Path, connection: sqlite3.Connection) -> Rigs | None:
    """The same; as COLMAP 3.12 and later has them; a rig of one camera is a plain image."""
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if not {"rigs", "rig_sensors", "frames", "frame_data"} <= tables:
        return None
    rotations: dict[Any, NDArray[np.float64]] = {}
    several = set()
    for rig, sensor, blob in connection.execute(
        "SELECT rig_id, sensor_id, sensor_from_rig FROM rig_sensors WHERE sensor_type = 0"
    ):
        several.add(rig)
        pose = sensor_from_rig_in(path, rig, sensor, blob)
        if pose is not None:
            rotations[sensor] = convert_family(pose[0], "vision")
    for rig, sensor in connection.execute(
        "SELECT rig_id, ref_sensor_id FROM rigs WHERE ref_sensor_type = 0"
    ):
        if rig in several:
            rotations[sensor] = np.eye(3)
    images: dict[Any, tuple[Any, Any]] = {}
    for name, frame, sensor, rig in connection.execute(
        "SELECT name, frames.frame_id, images.camera_id, rig_id FROM frame_data "
        "JOIN frames ON frame_data.frame_id = frames.frame_id "
        "JOIN images ON data_id = image_id WHERE sensor_type = 0 ORDER BY image_id"
    ):
        if rig in several:
            images[name] = frame, sensor
    if not images:
        return None
    here = {sensor for _, sensor in images.values()}
    try:
        return Rigs(images, {s: R for s, R in rotations.items() if s in here})
    except GraphError as error:
        raise FormatError(f"frame_data: {error}", path=path) from None

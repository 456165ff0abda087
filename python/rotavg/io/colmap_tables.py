"""What a COLMAP database has of cameras, rigs and frames, as it stands, for `colmap_model`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import sqlite3

Rows = list[tuple[Any, ...]]


@dataclass(frozen=True, eq=False, repr=False)
class ColmapTables:
    """Rows of the tables; where a database is older than rigs (3.12), those have none.

    Attributes:
        cameras: camera_id, model, width, height, parameters (a blob).
        rigs: rig_id, type and id of the reference sensor.
        sensors: rig_id, type and id of another sensor, sensor_from_rig (a blob, or None).
        frames: frame_id, rig_id.
        data: frame_id, type and id of a sensor, id of what it took (of a camera, the image's).
    """

    cameras: Rows
    rigs: Rows
    sensors: Rows
    frames: Rows
    data: Rows


def tables_in(connection: sqlite3.Connection) -> ColmapTables | None:
    """What the database has of them; None without cameras."""
    names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if "cameras" not in names:
        return None

    def rows(table: str, columns: str) -> Rows:
        if table != "cameras" and not {"rigs", "rig_sensors", "frames", "frame_data"} <= names:
            return []
        return connection.execute(f"SELECT {columns} FROM {table} ORDER BY 1, 2, 3").fetchall()

    return ColmapTables(
        rows("cameras", "camera_id, model, width, height, params"),
        rows("rigs", "rig_id, ref_sensor_type, ref_sensor_id"),
        rows("rig_sensors", "rig_id, sensor_type, sensor_id, sensor_from_rig"),
        rows("frames", "frame_id, rig_id, 0"),
        rows("frame_data", "frame_id, sensor_type, sensor_id, data_id"),
    )

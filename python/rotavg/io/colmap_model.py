"""A COLMAP model, a folder of texts: the rotations of a solution with cameras, rigs and frames.

    cameras.txt   CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]
    rigs.txt      RIG_ID NUM_SENSORS REF_TYPE REF_ID [TYPE ID HAS_POSE [qw qx qy qz tx ty tz]]
    frames.txt    FRAME_ID RIG_ID qw qx qy qz tx ty tz NUM_DATA [TYPE SENSOR_ID DATA_ID]
    images.txt    as in `colmap_images`
    points3D.txt  empty

It is made of the database that the graph is from. Poses are rig_from_world and sensor_from_rig.
Frames are where rotations put them, at the origin: a position is not known. Where images of a frame
are not turned as its rig says, since the rig was not used, every image is a frame by itself.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError, IncompleteWarning
from rotavg.graph.conventions import convert_family, quaternions_from_matrices, wxyz_from_xyzw
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_database import COLMAP_DATABASE, ColmapImages
from rotavg.io.colmap_images import COLMAP_IMAGES, image_lines
from rotavg.io.colmap_priors import sensor_from_rig_in
from rotavg.io.colmap_tables import ColmapTables
from rotavg.io.lines import exactly
from rotavg.io.registry import Format, SolutionLike, Writable

_OURS = "# Rotations by rotavg"
_FILES = ("cameras.txt", "frames.txt", "images.txt", "points3D.txt", "rigs.txt")
_CAMERAS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE",
    "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE",
    "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip
_SENSORS = ("CAMERA", "IMU")
_SAME = 1e-6  # |R - Q C|, of images that are turned as their rig says

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Place:
    """Sensor_from_rig: R (3, 3), None where it is not known, and t (3,), zero where it is not."""

    R: Matrix | None
    t: Matrix


@dataclass(frozen=True, eq=False)
class _Scene:
    """Rigs and frames.

    Attributes:
        rigs: of every rig, type and id of its sensors with their places; the reference first.
        frames: of every frame, its rig, world_from_rig (3, 3), and type, sensor, id of its data.
    """

    rigs: dict[int, dict[tuple[int, int], _Place]]
    frames: dict[int, tuple[int, Matrix, list[tuple[int, int, int]]]]


def write_model(path: Path, item: Writable) -> dict[Path, bytes]:
    """The five files of the folder that `path`, its images.txt, is in."""
    assert not isinstance(item, MeasurementGraph)
    check_folder(path)
    source = item.graph.source
    if not isinstance(source, ColmapImages) or source.tables is None:
        found = "the graph is from no COLMAP database with cameras"
        raise FormatError(f"{found}, expected one, whose model this would be", path=path.parent)
    tables = source.tables
    world = {
        source.image_ids[name]: np.asarray(R)
        for name, R in zip(item.graph.nodes.tolist(), item.rotations)
    }
    cameras = {source.image_ids[name]: source.camera_ids[name] for name in source.image_ids}
    scene = _together(path.parent, item, tables, world)
    apart = scene is None
    if scene is None:
        scene = _apart(world, cameras)
    names = {source.image_ids[name]: name for name in item.graph.nodes.tolist()}
    contents = {
        "cameras.txt": [_camera(path.parent, row) for row in tables.cameras],
        "rigs.txt": [_rig(rig, sensors) for rig, sensors in scene.rigs.items()],
        "frames.txt": [_frame(frame, *what) for frame, what in scene.frames.items()],
        "images.txt": _images(path, scene, names),
        "points3D.txt": [],
    }
    if apart and tables.sensors:
        told = "the rigs are not in it, as its images are not turned as they say"
        hint = "rotavg.solve uses them with priors=rotavg.read_priors(path, graph)"
        warnings.warn(f"{path.parent}: {told} ({hint})", IncompleteWarning, stacklevel=3)
    return {
        path.with_name(name): "\n".join([_OURS, *lines, ""]).encode()
        for name, lines in contents.items()
    }


def check_folder(path: Path, source: Path | None = None) -> None:
    """Refuse to write a model where it would replace, or lie among, what others have written.

    Args:
        path: its images.txt.
        source: the file that the graph is read from; None where that is not known.

    Raises FileAccessError, and FormatError where the graph cannot be from a COLMAP database.
    """
    folder = path.parent
    if source is not None and not begins_as_database(source):
        found = f"the graph is from {source}"
        raise FormatError(f"{found}, expected a COLMAP database, which has cameras", path=folder)
    if not folder.is_dir():
        return
    for file in sorted(folder.iterdir()):
        if file.name not in _FILES or not _is_ours(file):
            expected = "expected a new or empty folder"
            reason = f"found {file.name} in it, which rotavg has not written, {expected}"
            raise FileAccessError(f"cannot be written: {reason}", path=folder)


def begins_as_database(path: Path) -> bool:
    """Whether the file is one of SQLite's; a pipe is not, and is not read."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return COLMAP_DATABASE.recognises(stream.read(len(COLMAP_DATABASE.magic)))


def _is_ours(file: Path) -> bool:
    if not file.is_file():
        return False
    with file.open("rb") as stream:
        return stream.read(len(_OURS)) == _OURS.encode()


def _together(
    folder: Path, solution: SolutionLike, tables: ColmapTables, world: dict[int, Matrix]
) -> _Scene | None:
    """The rigs and frames of the database, of images by id; None where these contradict them."""
    rigs = _rigs_of(folder, solution, tables)
    data: dict[int, list[tuple[int, int, int]]] = {}
    for frame, *what in tables.data:
        if what[0] != 0 or what[2] in world:
            data.setdefault(frame, []).append((what[0], what[1], what[2]))
    frames: dict[int, tuple[int, Matrix, list[tuple[int, int, int]]]] = {}
    here: set[int] = set()
    for frame, rig, _ in tables.frames:
        images = [(kind, s, i) for kind, s, i in data.get(frame, []) if kind == 0]
        if not images:
            continue
        places = [rigs.get(rig, {}).get((0, sensor)) for _, sensor, _ in images]
        turns = [
            world[image] @ place.R
            for (_, _, image), place in zip(images, places)
            if place is not None and place.R is not None
        ]
        if len(turns) < len(images) or np.abs(np.array(turns) - turns[0]).max() > _SAME:
            return None
        frames[frame] = rig, turns[0], data[frame]
        here.update(image for _, _, image in images)
    return _Scene(rigs, frames) if here == world.keys() else None


def _rigs_of(
    folder: Path, solution: SolutionLike, tables: ColmapTables
) -> dict[int, dict[tuple[int, int], _Place]]:
    """The sensors of every rig; those that nobody has calibrated as the solution has them."""
    fit = getattr(solution, "rigs", None)
    found = {} if fit is None else fit.rotation_of
    rigs = {rig: {(kind, ref): _Place(np.eye(3), np.zeros(3))} for rig, kind, ref in tables.rigs}
    for rig, kind, sensor, blob in tables.sensors:
        if rig not in rigs:
            raise FormatError(f"sensor {sensor} is of rig {rig}, which is not there", path=folder)
        pose = sensor_from_rig_in(folder, rig, sensor, blob)
        if pose is not None:
            place = _Place(pose[0], np.where(np.isfinite(pose[1]), pose[1], 0.0))
        elif kind == 0 and sensor in found:
            place = _Place(convert_family(np.asarray(found[sensor]), "vision"), np.zeros(3))
        else:
            place = _Place(None, np.zeros(3))
        rigs[rig][kind, sensor] = place
    return rigs


def _apart(world: dict[int, Matrix], cameras: dict[int, int]) -> _Scene:
    """Every camera a rig, every image a frame."""
    rigs = {cameras[i]: {(0, cameras[i]): _Place(np.eye(3), np.zeros(3))} for i in world}
    frames = {i: (cameras[i], R, [(0, cameras[i], i)]) for i, R in world.items()}
    return _Scene(rigs, frames)


def _camera(folder: Path, row: tuple[Any, ...]) -> str:
    camera, model, width, height, blob = row
    if not (isinstance(model, int) and 0 <= model < len(_CAMERAS)):
        found = f"camera {camera} of the database is of the model {model}"
        raise FormatError(f"{found}, expected one from 0 to {len(_CAMERAS) - 1}", path=folder)
    parameters = np.frombuffer(blob or b"", dtype="<f8")
    return " ".join([str(camera), _CAMERAS[model], f"{width} {height}", *exactly(parameters)])


def _rig(rig: int, sensors: dict[tuple[int, int], _Place]) -> str:
    (reference, _), *others = sensors.items()
    words = [str(rig), str(len(sensors)), _sensor(*reference)]
    for name, place in others:
        words += [_sensor(*name), "0" if place.R is None else f"1 {_pose(place.R, place.t)}"]
    return " ".join(words)


def _frame(frame: int, rig: int, Q: Matrix, data: list[tuple[int, int, int]]) -> str:
    took = " ".join(f"{_sensor(kind, sensor)} {item}" for kind, sensor, item in data)
    pose = _pose(convert_family(Q, "vision"), np.zeros(3))
    return f"{frame} {rig} {pose} {len(data)} {took}"


def _images(path: Path, scene: _Scene, names: dict[int, str]) -> list[str]:
    rows = []
    for rig, Q, data in scene.frames.values():
        for kind, sensor, image in data:
            place = scene.rigs[rig][kind, sensor]
            if kind == 0 and place.R is not None:
                rows.append((image, place.R @ Q.T, place.t, sensor, names[image]))
    return image_lines(path, *zip(*rows))


def _sensor(kind: int, sensor: int) -> str:
    return f"{_SENSORS[kind] if kind in (0, 1) else kind} {sensor}"


def _pose(R: Matrix, t: Matrix) -> str:
    wxyz = wxyz_from_xyzw(quaternions_from_matrices(R[None]))[0]
    return " ".join(exactly(np.concatenate([wxyz, t])))


COLMAP_MODEL = Format(
    name="colmap_model",
    suffixes=(),
    recognises=lambda head: False,
    read=None,
    has_graphs=False,
    write=write_model,
    convention=COLMAP_IMAGES.convention,
    main_file="images.txt",
    check_place=check_folder,
)

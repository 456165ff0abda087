"""Which images the sensors of rigs took together: COLMAP's rig_config.json, or a table.

The JSON is what `colmap rig_configurator` reads: a list of rigs, each with `cameras`, of which one
has `"ref_sensor": true`. Images whose names begin with the camera's `image_prefix` are its own, and
those with the same rest of the name are a frame; `cam_from_rig_rotation` (w x y z) is where it is
known. The table is CSV with a header: node, frame, sensor and, where it is known,
qw, qx, qy, qz of rig_from_sensor; one line of a sensor that has it is enough.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError, GraphError, IncompleteWarning, expect
from rotavg.graph.conventions import convert_family, matrices_from_quaternions
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import json_data
from rotavg.io.colmap_database import COLMAP_DATABASE, ColmapImages
from rotavg.io.colmap_priors import read_rigs_of
from rotavg.io.lines import (
    BYTE_ORDER_MARK,
    comma_fields,
    content_lines,
    integer,
    is_number,
    lines_of,
    not_utf8,
    shown,
)
from rotavg.io.registry import read_bytes
from rotavg.io.rounding import is_unit
from rotavg.priors.priors import Rigs

_QUATERNION = ("qw", "qx", "qy", "qz")


def read_rigs(path: str | os.PathLike[str], graph: MeasurementGraph) -> Rigs:
    """Read rigs of the nodes of a graph.

    Args:
        path: COLMAP's rig_config.json, a COLMAP database (version 3.12 or later), or a CSV file of
            node, frame, sensor[, qw, qx, qy, qz].
        graph: the measurements; what the file says of other nodes is left out.

    Warns:
        IncompleteWarning: the file has sensors of which the graph has no image, or a table nodes
            that the graph has not.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds something else; the message names the line, or the rig and camera.
    """
    path = Path(path)
    expect(graph, MeasurementGraph)
    data = read_bytes((COLMAP_DATABASE,), path, "rigs")
    if COLMAP_DATABASE.recognises(data):
        found = read_rigs_of(path)
        if found is None:
            raise FormatError("the database has no rig of several cameras", path=path)
        return restricted(found, graph)
    if data.removeprefix(BYTE_ORDER_MARK).lstrip()[:1] in (b"[", b"{"):
        return _from_config(path, data, graph)
    return _from_table(path, data, graph)


def rigs_of(graph: MeasurementGraph) -> Rigs | None:
    """The rigs that a graph brought along from a COLMAP database, of the nodes that it has.

    None where no edge would be left between two frames, or there are no rigs.
    """
    source = graph.source
    return joining_frames(source.rigs if isinstance(source, ColmapImages) else None, graph)


def joining_frames(rigs: Rigs | None, graph: MeasurementGraph) -> Rigs | None:
    """The same of any rigs."""
    if rigs is None:
        return None
    rigs = restricted(rigs, graph)
    frame = [rigs.images.get(node, (None, node))[0] for node in graph.nodes.tolist()]
    own = [(k,) if f is None else f for k, f in enumerate(frame)]
    between = any(own[i] != own[j] for i, j in graph.indices.tolist())
    return rigs if rigs.images and between else None


def restricted(rigs: Rigs, graph: MeasurementGraph) -> Rigs:
    """The same for the nodes that a graph has."""
    known = set(graph.nodes.tolist())
    images = {k: v for k, v in rigs.images.items() if k in known}
    sensors = {sensor for _, sensor in images.values()}
    return Rigs(images, {s: C for s, C in rigs.rotations.items() if s in sensors})


def _from_config(path: Path, data: bytes, graph: MeasurementGraph) -> Rigs:
    configuration = json_data.loaded(path, data)
    if graph.nodes.dtype.kind != "U":
        found = "nodes of the graph are numbers"
        raise FormatError(f"{found}, expected names of images, as prefixes are for", path=path)
    if not isinstance(configuration, list) or not configuration:
        raise FormatError("found no list of rigs, expected COLMAP's rig_config.json", path=path)
    images: dict[Any, tuple[Any, Any]] = {}
    rotations: dict[Any, NDArray[np.float64]] = {}
    prefixes: list[str] = []
    for k, rig in enumerate(configuration, 1):
        cameras = rig.get("cameras") if isinstance(rig, dict) else None
        if not isinstance(cameras, list) or not cameras:
            raise FormatError(f"rig {k} has no list of cameras", path=path)
        references = 0
        for number, camera in enumerate(cameras, 1):
            where = f"rig {k}, camera {number}"
            prefix = camera.get("image_prefix") if isinstance(camera, dict) else None
            if not isinstance(prefix, str):
                raise FormatError(f"{where}: found no image_prefix", path=path)
            if prefix in prefixes:
                raise FormatError(f"{where}: the prefix {prefix!r} stands twice", path=path)
            prefixes.append(prefix)
            if camera.get("ref_sensor"):
                references += 1
                rotations[prefix] = np.eye(3)
            elif camera.get("cam_from_rig_rotation") is not None:
                wxyz = camera["cam_from_rig_rotation"]
                R = _rotation(path, json_data.numbers(path, wxyz, 4, where), where)
                rotations[prefix] = convert_family(R, "vision")
            for name in graph.nodes.tolist():
                if name.startswith(prefix):
                    if name in images:
                        found = f"{where}: the image {name!r} is of another camera already"
                        raise FormatError(found, path=path)
                    images[name] = f"rig {k}: {name[len(prefix) :]}", prefix
        if references != 1:
            found = f"rig {k} has {references} reference sensors"
            raise FormatError(f"{found}, expected one with ref_sensor", path=path)
    if not images:
        raise FormatError("no image of the graph begins with any of the prefixes", path=path)
    return _present(path, images, rotations, prefixes)


def _from_table(path: Path, data: bytes, graph: MeasurementGraph) -> Rigs:
    rows = _rows(path, data)
    header = [field.lower() for field in rows[0][1]] if rows else []
    if header[:3] != ["node", "frame", "sensor"]:
        found = "found no header node,frame,sensor"
        raise FormatError(f"{found}, nor COLMAP's rig_config.json", path=path, line=1)
    column = {name: k for k, name in enumerate(header)}
    has_rotations = all(name in column for name in _QUATERNION)
    named = graph.nodes.dtype.kind == "U"
    known = set(graph.nodes.tolist())
    images: dict[Any, tuple[Any, Any]] = {}
    rotations: dict[Any, NDArray[np.float64]] = {}
    listed: set[Any] = set()
    taken: dict[tuple[str, str], int] = {}
    sensors: dict[str, None] = {}
    for line, fields in rows[1:]:
        if len(fields) != len(header):
            found = f"found {len(fields)} fields, expected {len(header)}"
            raise FormatError(found, path=path, line=line)
        try:
            node: Any = fields[0] if named else integer(fields[0])
        except ValueError:
            found = f"found the node {fields[0]!r}, expected an integer"
            raise FormatError(found, path=path, line=line) from None
        quaternion = [fields[column[name]] for name in _QUATERNION] if has_rotations else [""] * 4
        if any(quaternion):
            R = _rotation(path, _quaternion(path, line, quaternion), None, line)
            sensor = fields[2]
            if sensor in rotations and not np.allclose(rotations[sensor], R, atol=1e-9):
                found = f"the sensor {sensor!r} has another rotation before"
                raise FormatError(found, path=path, line=line)
            rotations[sensor] = R
        if node in listed:
            raise FormatError(f"the node {node!r} stands twice", path=path, line=line)
        listed.add(node)
        sensors[fields[2]] = None
        if node in known:
            before = taken.setdefault((fields[1], fields[2]), line)
            if before != line:
                found = f"the node {node!r} is the second of sensor {fields[2]!r} in one frame"
                raise FormatError(f"{found}, before in line {before}", path=path, line=line)
            images[node] = fields[1], fields[2]
    if not images:
        raise FormatError("none of the nodes in the file is in the graph", path=path)
    if len(images) < len(listed):
        count = len(listed) - len(images)
        told = f"{path}: {count} of {len(listed)} nodes are not in the graph"
        warnings.warn(told, IncompleteWarning, stacklevel=3)
    return _present(path, images, rotations, sensors)


def _present(
    path: Path,
    images: dict[Any, tuple[Any, Any]],
    rotations: dict[Any, NDArray[np.float64]],
    sensors: Iterable[Any],
) -> Rigs:
    """The rigs of the sensors that these images have; of others in the file it is told."""
    here = {sensor for _, sensor in images.values()}
    absent = [sensor for sensor in sensors if sensor not in here]
    if absent:
        names = ", ".join(map(repr, absent[:3])) + (", ..." if len(absent) > 3 else "")
        told = f"{path}: the graph has no image of {len(absent)} of the sensors: {names}"
        warnings.warn(told, IncompleteWarning, stacklevel=4)
    try:
        return Rigs(images, {s: R for s, R in rotations.items() if s in here})
    except GraphError as error:
        raise FormatError(str(error), path=path) from None


def _rows(path: Path, data: bytes) -> list[tuple[int, list[str]]]:
    """(line number, fields) of the lines that are neither blank nor a comment."""
    next(content_lines(path, data), None)  # refuses what is binary
    rows = []
    for line, text in enumerate(lines_of(data), 1):
        if text.strip() and not text.lstrip().startswith(b"#"):
            try:
                rows.append((line, comma_fields(path, line, text.decode())))
            except UnicodeDecodeError:
                raise not_utf8(path, text, line) from None
    return rows


def _quaternion(path: Path, line: int, fields: list[str]) -> NDArray[np.float64]:
    for field in fields:
        if not is_number(field.encode()):
            found = f"found {shown(field.encode())}, expected a number"
            raise FormatError(found, path=path, line=line)
    return np.array(fields, dtype=np.float64)


def _rotation(
    path: Path, wxyz: NDArray[np.float64], where: str | None, line: int | None = None
) -> NDArray[np.float64]:
    if not is_unit(wxyz):
        prefix = "" if where is None else f"{where}: "
        found = f"{prefix}found the rotation {wxyz.tolist()}"
        raise FormatError(f"{found}, expected a unit quaternion w x y z", path=path, line=line)
    return matrices_from_quaternions(wxyz[[1, 2, 3, 0]])

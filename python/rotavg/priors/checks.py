"""What can be wrong with rigs before there is a graph."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError
from rotavg.graph.nearest import TOLERANCE, orthogonality_errors, why_no_rotation


def check_rigs(images: Mapping[Any, Any], rotations: Mapping[Any, Any]) -> None:
    """GraphError for what is no frame and sensor, a sensor twice in a frame, or no rotation.

    Also where rotations are given, and none of a sensor that an image has.
    """
    for name, value in (("images", images), ("rotations", rotations)):
        if not isinstance(value, Mapping):
            raise GraphError(f"{name} of rigs are no mapping, expected a dict")
    taken: set[tuple[Any, Any]] = set()
    sensors: dict[Any, None] = {}
    for node, value in images.items():
        what = f"the rig prior of node {node!r}"
        if not isinstance(value, (tuple, list)) or len(value) != 2:
            raise GraphError(f"{what} is {value!r}, expected a pair of frame and sensor")
        for kind, name in zip(("frame", "sensor"), value):
            if not isinstance(name, (int, str, np.integer)):
                found = f"{what} has the {kind} {name!r}"
                raise GraphError(f"{found}, expected an integer or a name")
        if tuple(value) in taken:
            raise GraphError(f"{what} is the second of its sensor in one frame")
        taken.add(tuple(value))
        sensors[value[1]] = None
    for sensor, C in rotations.items():
        matrix = as_floats(C, (3, 3), f"the rotation of sensor {sensor!r}")
        error = float(orthogonality_errors(matrix[None])[0])
        if not error <= TOLERANCE:
            reason = why_no_rotation(matrix, error, TOLERANCE)
            raise GraphError(f"the rotation of sensor {sensor!r} {reason}")
    if images and rotations and not any(sensor in sensors for sensor in rotations):
        found = ", ".join(map(repr, list(rotations)[:3]))
        expected = ", ".join(map(repr, list(sensors)[:3]))
        more = ", ..." if len(sensors) > 3 else ""
        raise GraphError(f"no image has a sensor whose rotation is given ({found}); there are "
                         f"{expected}{more}")  # fmt: skip


def check_fixed(
    fixed: Mapping[Any, Any], images: Mapping[Any, Any], known: Mapping[Any, Any]
) -> None:
    """GraphError for a fixed rotation of an image whose sensor is to be estimated.

    That is one of a rig another sensor of which is known; without such, the order of the graph
    tells which one is the reference.
    """
    held = [node for node in fixed if node in images and images[node][1] not in known]
    if not held or not known:
        return
    rig: dict[Any, Any] = {}  # every sensor points to one of its rig, in the end to the same

    def find(sensor: Any) -> Any:
        while rig.setdefault(sensor, sensor) != sensor:
            sensor = rig[sensor]
        return sensor

    first: dict[Any, Any] = {}
    for frame, sensor in images.values():
        rig[find(sensor)] = find(first.setdefault(frame, sensor))
    calibrated = {find(sensor) for sensor in known}
    for node in held:
        if find(images[node][1]) in calibrated:
            raise GraphError(
                f"the fixed prior of node {node!r} is of an image whose sensor has no known "
                "rotation in its rig"
            )

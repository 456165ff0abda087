"""JRL, JSON Robot Log (McGann 2023), of one robot or several; pose family.

    {"name": "...", "robots": ["a"],
     "measurements": {"a": [{"stamp": 0, "measurements": [
        {"type": "BetweenFactorPose3", "key1": i, "key2": j, "covariance": [36],
         "measurement": {"type": "Pose3", "translation": [3], "rotation": [w, x, y, z]}}, ...]}]}}

Keys are GTSAM's. Covariances stand row by row, in GTSAM's order: rotation first, in the plane x, y,
theta. Of all measurements the BetweenFactorPose3 or BetweenFactorPose2 are read.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import (
    first_bad_quaternion,
    matrices_from_angles_about_z,
    matrices_from_quaternions,
    xyzw_from_wxyz,
)
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.angles import angle_notes
from rotavg.io.json_data import entries, member, numbers, parsed, whole
from rotavg.io.measured_poses import Places, in_space, inverse, measured_poses
from rotavg.io.registry import Format, ReadOptions
from rotavg.io.rounding import quaternion_notes

_START = re.compile(rb"^\s*(\xef\xbb\xbf)?\{")
_FACTOR = re.compile(rb'"type"\s*:\s*"(Between|Prior|Range|BearingRange)Factor\w+"')
_KINDS = {"BetweenFactorPose3": 3, "BetweenFactorPose2": 2}
_TRANSLATION_FIRST = np.array([3, 4, 5, 0, 1, 2])


@dataclass
class _Found:
    """The measurements of one kind: ends, numbers of the poses, covariances, and places."""

    edges: list[tuple[int, int]] = field(default_factory=list)
    poses: list[Any] = field(default_factory=list)
    covariances: list[Any] = field(default_factory=list)
    names: list[str] = field(default_factory=list)


def read_jrl(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the relative poses of all robots; other measurements are counted and told."""
    robots = member(path, parsed(path, data), "measurements", "the file")
    if not isinstance(robots, dict):
        raise FormatError("measurements: expected an object of robots", path=path)
    found = {kind: _Found() for kind in _KINDS}
    others: Counter[str] = Counter()
    for robot, log in robots.items():
        for k, entry in enumerate(entries(path, log, f"measurements.{robot}")):
            where = f"measurements.{robot}[{k}]"
            listed = entries(path, member(path, entry, "measurements", where), where)
            for m, measured in enumerate(listed):
                name = f"{where}.measurements[{m}]"
                kind = str(member(path, measured, "type", name))
                if kind in _KINDS:
                    _add(path, found[kind], measured, name, _KINDS[kind])
                else:
                    others[kind] += 1
    kind = max(found, key=lambda name: len(found[name].edges))
    chosen, dimension = found[kind], _KINDS[kind]
    if not chosen.edges:
        told = ", ".join(f"{name}: {count}" for name, count in others.most_common(5)) or "nothing"
        expected = "expected BetweenFactorPose3 or BetweenFactorPose2"
        raise FormatError(f"the file has no relative poses; found {told}, {expected}", path=path)
    others += Counter({name: len(f.edges) for name, f in found.items() if f is not chosen})
    notes: tuple[str, ...] = ()
    if others:
        told = ", ".join(f"{name}: {count}" for name, count in (+others).most_common(5))
        notes += (f"{sum(others.values())} other measurements skipped ({told})",) if told else ()
    places = Places(chosen.names)
    poses = np.array(chosen.poses)
    omega = inverse(path, np.array(chosen.covariances), places)
    if dimension == 2:
        rotations = matrices_from_angles_about_z(poses[:, 2:])
        notes += angle_notes(poses[:, 2:], chosen.names)
        vectors = np.hstack([poses[:, :2], np.zeros((len(poses), 1))])
        omega = in_space(omega)
    else:
        turns = xyzw_from_wxyz(poses[:, 3:])
        bad = first_bad_quaternion(turns)
        if bad is not None:
            raise places.error(path, *bad)
        try:
            notes += quaternion_notes(path, turns, range(1, len(turns) + 1))
        except FormatError as error:
            row = (error.line or 1) - 1
            with np.errstate(over="ignore"):
                length = float(np.linalg.norm(turns[row]))
            reason = f"found a quaternion of length {length:.6g}, expected length 1"
            raise places.error(path, row, reason) from None
        rotations, vectors = matrices_from_quaternions(turns), poses[:, :3]
        omega = omega[:, _TRANSLATION_FIRST[:, None], _TRANSLATION_FIRST]
    return measured_poses(
        path, places, chosen.edges, rotations, vectors, omega, options,
        dimension=dimension, notes=notes,
    )  # fmt: skip


def _add(path: Path, found: _Found, measured: Any, name: str, dimension: int) -> None:
    ends = [whole(path, member(path, measured, f"key{k}", name), f"{name}.key{k}") for k in (1, 2)]
    pose = member(path, measured, "measurement", name)
    inside = f"{name}.measurement"
    parts: tuple[tuple[str, int], ...] = (("x", 1), ("y", 1), ("theta", 1))
    if dimension == 3:
        parts = (("translation", 3), ("rotation", 4))
    found.poses.append(
        np.concatenate(
            [
                numbers(path, member(path, pose, part, inside), count, f"{inside}.{part}")
                for part, count in parts
            ]
        )
    )
    size = 3 * dimension - 3
    given = member(path, measured, "covariance", name)
    covariance = numbers(path, given, size * size, f"{name}.covariance")
    found.covariances.append(covariance.reshape(size, size))
    found.edges.append((ends[0], ends[1]))
    found.names.append(name)


JRL = Format(
    name="jrl",
    suffixes=(".jrl",),
    recognises=lambda head: _START.search(head) is not None and _FACTOR.search(head) is not None,
    read=read_jrl,
    write=None,
)

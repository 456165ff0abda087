"""JRL, JSON Robot Log (McGann 2023), of one robot or several; pose family.

    {"name": "...", "robots": ["a"],
     "measurements": {"a": [{"stamp": 0, "measurements": [
        {"type": "BetweenFactorPose3", "key1": i, "key2": j, "covariance": [36],
         "measurement": {"type": "Pose3", "translation": [3], "rotation": [w, x, y, z]}}, ...]}]}}

Keys are GTSAM's. Covariances stand row by row, in GTSAM's order: rotation first, in the plane x, y,
theta. Of all measurements the BetweenFactorPose3 or BetweenFactorPose2 are read, and priors

        {"type": "PriorFactorPose3", "key": i, "covariance": [36], "prior": {"type": "Pose3", ...}}

on Pose3 and Rot3, or Pose2 and Rot2, where they are used.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import matrices_from_angles_about_z, xyzw_from_wxyz
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.angles import angle_notes
from rotavg.io.json_data import entries, member, numbers, parsed, whole
from rotavg.io.measured_poses import in_space, inverse, measured_poses, turned
from rotavg.io.places import Places
from rotavg.io.pose_priors import PosePrior, PriorsOfFile, of_poses, tell
from rotavg.io.registry import Format, ReadOptions, how_used

Floats = NDArray[np.float64]

_START = re.compile(rb"^\s*(\xef\xbb\xbf)?\{")
_FACTOR = re.compile(rb'"type"\s*:\s*"(Between|Prior|Range|BearingRange)Factor\w+"')
_POSES = ("Pose3", "Pose2")
# What values are made of.
_PARTS = {
    "Pose3": (("translation", 3), ("rotation", 4)),
    "Rot3": (("rotation", 4),),
    "Pose2": (("x", 1), ("y", 1), ("theta", 1)),
    "Rot2": (("theta", 1),),
}
# Where their covariance has what ours has, translation first.
_PLACES = {"Pose3": [3, 4, 5, 0, 1, 2], "Rot3": [3, 4, 5], "Pose2": [0, 1, 2], "Rot2": [2]}


@dataclass
class _Found:
    """The measurements of values of one kind: keys, numbers of the values, covariances, places."""

    kind: str
    keys: list[tuple[int, ...]] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)
    covariances: list[Any] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(
        self, path: Path, factor: Any, name: str, keys: tuple[str, ...], value_name: str
    ) -> None:
        """Keep a factor; FormatError for what it should not hold."""
        ids = [whole(path, member(path, factor, key, name), f"{name}.{key}") for key in keys]
        value, inside = member(path, factor, value_name, name), f"{name}.{value_name}"
        self.values.append(
            np.concatenate(
                [
                    numbers(path, member(path, value, part, inside), count, f"{inside}.{part}")
                    for part, count in _PARTS[self.kind]
                ]
            )
        )
        size = len(_PLACES[self.kind])
        given = member(path, factor, "covariance", name)
        covariance = numbers(path, given, size * size, f"{name}.covariance")
        self.covariances.append(covariance.reshape(size, size))
        self.keys.append(tuple(ids))
        self.names.append(name)

    def in_space(self, path: Path) -> tuple[Floats, Floats, Floats, tuple[str, ...]]:
        """Rotations (m, 3, 3), translations (m, 3), information (m, 6, 6), and notes."""
        places, values = Places(self.names), np.array(self.values)
        given = inverse(path, np.array(self.covariances), places)
        flat = self.kind in ("Pose2", "Rot2")
        omega = np.zeros((len(values), 3, 3) if flat else (len(values), 6, 6))
        order = np.array(_PLACES[self.kind])
        omega[:, order[:, None], order] = given
        vectors = np.zeros((len(values), 3))
        if flat:
            vectors[:, :2] = values[:, :-1] if self.kind == "Pose2" else 0.0
            turns = values[:, -1:]
            notes = angle_notes(turns, self.names)
            return matrices_from_angles_about_z(turns), vectors, in_space(omega), notes
        vectors[:] = values[:, :-4] if self.kind == "Pose3" else 0.0
        rotations, notes = turned(path, places, xyzw_from_wxyz(values[:, -4:]))
        return rotations, vectors, omega, notes


def read_jrl(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the relative poses of all robots, and keep their priors; others are told."""
    robots = member(path, parsed(path, data), "measurements", "the file")
    if not isinstance(robots, dict):
        raise FormatError("measurements: expected an object of robots", path=path)
    found = {f"BetweenFactor{kind}": _Found(kind) for kind in _POSES}
    priors: list[tuple[str, str, Any]] = []  # kind of the value, where it stands, and the factor
    others: Counter[str] = Counter()
    for robot, log in robots.items():
        for k, entry in enumerate(entries(path, log, f"measurements.{robot}")):
            where = f"measurements.{robot}[{k}]"
            listed = entries(path, member(path, entry, "measurements", where), where)
            for m, measured in enumerate(listed):
                name = f"{where}.measurements[{m}]"
                kind = str(member(path, measured, "type", name))
                if kind in found:
                    found[kind].add(path, measured, name, ("key1", "key2"), "measurement")
                elif kind.startswith("PriorFactor") and kind.removeprefix("PriorFactor") in _PARTS:
                    priors.append((kind.removeprefix("PriorFactor"), name, measured))
                else:
                    others[kind] += 1
    chosen = max(found.values(), key=lambda kept: len(kept.keys))
    dimension = chosen.kind[-1]
    others += Counter(f"PriorFactor{kind}" for kind, _, _ in priors if kind[-1] != dimension)
    priors = [prior for prior in priors if prior[0][-1] == dimension]
    if not chosen.keys:
        others += Counter(f"PriorFactor{kind}" for kind, _, _ in priors)
        told = ", ".join(f"{name}: {count}" for name, count in others.most_common(5)) or "nothing"
        expected = "expected BetweenFactorPose3 or BetweenFactorPose2"
        raise FormatError(f"the file has no relative poses; found {told}, {expected}", path=path)
    others += Counter({name: len(f.keys) for name, f in found.items() if f is not chosen})
    notes: tuple[str, ...] = ()
    if others:
        told = ", ".join(f"{name}: {count}" for name, count in (+others).most_common(5))
        notes += (f"{sum(others.values())} other measurements skipped ({told})",) if told else ()
    source = None
    if priors:
        source = PriorsOfFile(path, len(priors), priors, _read_priors)
        notes += (f"{source.knows}{how_used(path)}",)
    rotations, vectors, omega, more = chosen.in_space(path)
    return measured_poses(
        path, Places(chosen.names), [(i, j) for i, j in chosen.keys], rotations, vectors, omega,
        options, dimension=int(dimension), notes=notes + more, source=source,
    )  # fmt: skip


def _read_priors(path: Path, priors: Sequence[tuple[str, str, Any]]) -> list[PosePrior]:
    kinds = {kind: _Found(kind) for kind, _, _ in priors}
    for kind, name, factor in priors:
        kinds[kind].add(path, factor, name, ("key",), "prior")
    result = []
    for found in kinds.values():
        rotations, vectors, omega, notes = found.in_space(path)
        tell(path, notes)
        nodes = [node for (node,) in found.keys]
        result += of_poses(Places(found.names), nodes, rotations, vectors, omega)
    return result


JRL = Format(
    name="jrl",
    suffixes=(".jrl",),
    recognises=lambda head: _START.search(head) is not None and _FACTOR.search(head) is not None,
    read=read_jrl,
    write=None,
)

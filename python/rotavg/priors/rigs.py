"""Rigs some of whose sensors are where nobody knows, and what was found of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import Brief, as_floats, read_only
from rotavg.base.errors import GraphError, expect
from rotavg.graph.counted_weights import counted_weights
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.grounded import Grounded, core_priors, ground, of_nodes, prior_error
from rotavg.priors.priors import Priors, Rigs

_RELATIVE_ROUNDING = 1e-26  # of the weights: below, the measurements fit to rounding


@dataclass(frozen=True, eq=False)
class RigFit(Brief):
    """What was found of the sensors of rigs.

    A mapping from a sensor to its rotation is `rotation_of`; a frame's is in `frames`.

    Attributes:
        sensors: their ids, in the order of their first nodes in the graph.
        rotations: (s, 3, 3) frame_from_sensor; those that were given, bit by bit.
        origin: (s,) "known", "estimated", or "reference": none of its rig was given and it is the
            first, so that it has the identity.
        determined: (s,) whether the measurements tell it: False where the objective does not rise
            in some direction from it.
        frames: world_from_frame (3, 3) of every frame.
        converged: whether frames and sensors together ended at a stationary point.
        iterations: steps of Newton's method for frames and sensors together.
        relative_gradient: the largest over frames and sensors, radians.
        objective: f of the solution.
        lower_bound: no frames and sensors have a smaller f than this (with the weights of the
            solution); None where no certificate was asked for, or nothing was estimated.
        rig_objective: the part of f in components of the graph that have an image of a rig.
        rig_weight: the weights there, for what is zero to rounding, as `counted_weights` has them.
        alone: sensors that are in no frame with another one, and not known: nothing can tell where
            they are in a rig.
        images: frame and sensor of the nodes.
        priors: all that is known with all sensors held: for `rotavg.certify`.
    """

    sensors: tuple[Any, ...]
    rotations: NDArray[np.float64]
    origin: tuple[str, ...]
    determined: NDArray[np.bool_]
    frames: Mapping[Any, NDArray[np.float64]]
    converged: bool
    iterations: int
    relative_gradient: float
    objective: float
    lower_bound: float | None
    rig_objective: float
    rig_weight: float
    alone: tuple[Any, ...]
    images: Mapping[Any, tuple[Any, Any]]
    priors: Priors

    @property
    def rotation_of(self) -> dict[Any, NDArray[np.float64]]:
        """frame_from_sensor (3, 3) of every sensor."""
        return dict(zip(self.sensors, self.rotations))

    @property
    def estimated(self) -> NDArray[np.bool_]:
        """(s,) whether the sensor was estimated."""
        return np.array([origin == "estimated" for origin in self.origin], dtype=bool)

    @property
    def joint_gap(self) -> float | None:
        """At most so much of f could other frames and sensors gain together."""
        if self.lower_bound is None:
            return None
        return max(0.0, self.objective - self.lower_bound)

    @property
    def sentence(self) -> str:
        """How many sensors came from where, and what is known of the whole."""
        counts = {name: self.origin.count(name) for name in ("known", "reference", "estimated")}
        some = [f"{count} {name}" for name, count in counts.items() if count]
        text = f"{len(self.sensors)} sensors ({', '.join(some)}) in {len(self.frames)} frames"
        lost = [s for s, good in zip(self.sensors, self.determined) if not good]
        if lost:
            text += f"; not determined by the measurements: {', '.join(map(repr, lost))}"
        if self.alone:
            text += f"; in no frame with another: {', '.join(map(repr, self.alone))}"
        if not self.converged:
            text += (
                f"; sensors and frames have not converged (relative gradient "
                f"{self.relative_gradient:.1g})"
            )
        gap = self.joint_gap
        if gap is not None:
            text += f"; {self._joint(gap)}"
        return text

    def _joint(self, gap: float) -> str:
        if gap <= max(1e-6 * self.rig_objective, _RELATIVE_ROUNDING * self.rig_weight):
            return "proved for frames and sensors together"
        if gap >= self.rig_objective:  # it is that of the priors, too
            return "how much other sensors could lower the objective of the rigs is not known"
        share = 100 * gap / self.rig_objective
        return f"other sensors could lower the objective of the rigs by at most {share:.2g} %"


def is_rigs(priors: Priors | None) -> bool:
    """Whether rigs are given by their sensors."""
    return priors is not None and isinstance(priors.rigs, Rigs)


@dataclass(frozen=True, eq=False)
class Sensors:
    """Rigs of one graph, as the core takes them."""

    graph: MeasurementGraph
    priors: Priors
    rigs: Rigs
    images: dict[Any, tuple[Any, Any]]  # by the graph's ids
    names: list[Any]
    core: _core.Rigs
    others: _core.Priors

    def error(self, error: _core.InvalidPrior) -> GraphError:
        """What the core refuses, by names."""
        kind, row, reason = error.args
        if kind == "sensor":
            return GraphError(f"the rotation of sensor {self.names[row]!r} {reason}")
        return prior_error(self.graph, error)

    def _rig_part(
        self, rotations: NDArray[np.float64], weights: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Objective and weight of the components that have an image of a rig."""
        label, (i, j) = self.graph.components(), self.graph.indices.T
        mine = np.isin(label, label[[node in self.images for node in self.graph.nodes.tolist()]])
        k = np.flatnonzero(mine[i])
        residual = rotations[i[k]] @ self.graph.rotations[k] - rotations[j[k]]
        w = weights[k]
        lightest = np.full(label.max() + 1, np.inf)
        np.minimum.at(lightest, label[i[k]], w)
        counted = counted_weights(w, lightest[label[i[k]]])
        return float(w @ (residual**2).sum(axis=(1, 2))), float(counted.sum())

    def fit(
        self,
        core: dict[str, Any],
        rotations: NDArray[np.float64],
        f: float,
        weights: NDArray[np.float64],
    ) -> RigFit:
        """From what the core found, the rotations (n, 3, 3) of all nodes, and the final weights."""
        ids = tuple(self.names[k] for k in core["sensors"])
        C = np.array(core["rotations"], dtype=np.float64)
        for k, sensor in enumerate(ids):
            if sensor in self.rigs.rotations:
                C[k] = np.asarray(self.rigs.rotations[sensor], dtype=np.float64)
        of_sensor = dict(zip(ids, C))
        row = {node: k for k, node in enumerate(self.graph.nodes.tolist())}
        frames: dict[Any, NDArray[np.float64]] = {}
        for node, (frame, sensor) in self.images.items():
            if frame not in frames:
                frames[frame] = read_only(rotations[row[node]] @ of_sensor[sensor].T)
        rig_objective, rig_weight = self._rig_part(rotations, weights)
        held = {node: (frame, of_sensor[sensor]) for node, (frame, sensor) in self.images.items()}
        return RigFit(
            sensors=ids,
            rotations=read_only(C),
            origin=tuple(core["origin"]),
            determined=read_only(np.array(core["determined"], dtype=bool)),
            frames=frames,
            converged=core["converged"],
            iterations=core["iterations"],
            relative_gradient=core["relative_gradient"],
            objective=f,
            lower_bound=core["lower_bound"],
            rig_objective=rig_objective,
            rig_weight=rig_weight,
            alone=self._alone(dict(zip(ids, core["origin"]))),
            images=self.images,
            priors=replace(self.priors, rigs=held),
        )

    def _alone(self, origin: dict[Any, str]) -> tuple[Any, ...]:
        together: dict[Any, set[Any]] = {}
        for frame, sensor in self.images.values():
            together.setdefault(frame, set()).add(sensor)
        accompanied = {s for of_frame in together.values() if len(of_frame) > 1 for s in of_frame}
        several = len(origin) > 1  # one sensor is no rig
        return tuple(s for s in origin if several and origin[s] != "known" and s not in accompanied)

    def grounded(self, fit: RigFit) -> Grounded:
        """The problem that was solved in the end, all sensors held."""
        result = ground(self.graph, fit.priors)
        assert result is not None
        return result


def sensors_of(graph: MeasurementGraph, priors: Priors) -> Sensors:
    """Rigs that are given by their sensors.

    Raises:
        GraphError: names the node or sensor that does not fit, and why.
    """
    expect(graph, MeasurementGraph)
    rigs = priors.rigs
    assert isinstance(rigs, Rigs)
    rows, frames, sensors, images = [], [], [], {}
    frame_rows: dict[Any, int] = {}
    sensor_rows: dict[Any, int] = {}
    for item in of_nodes(graph, rigs.images, "rig"):
        frame, sensor = item.value
        rows.append(item.row)
        frames.append(frame_rows.setdefault(frame, len(frame_rows)))
        sensors.append(sensor_rows.setdefault(sensor, len(sensor_rows)))
        images[graph.nodes[item.row].item()] = frame, sensor
    if not rows:
        raise GraphError("rigs have no images, expected a frame and a sensor of some nodes")
    # Sensors that no image has, such as those of another part of a data set, mean nothing here.
    known = {s: C for s, C in rigs.rotations.items() if s in sensor_rows}
    matrices = [as_floats(C, (3, 3), f"the rotation of sensor {s!r}") for s, C in known.items()]
    core = _core.Rigs(
        nodes=np.array(rows, dtype=np.int64),
        frames=np.array(frames, dtype=np.int64),
        sensors=np.array(sensors, dtype=np.int64),
        known=np.array([sensor_rows[s] for s in known], dtype=np.int64),
        known_rotations=np.array(matrices, dtype=np.float64).reshape(len(matrices), 3, 3),
    )
    others = core_priors(graph, replace(priors, rigs={}))
    return Sensors(graph, priors, rigs, images, list(sensor_rows), core, others)


def with_frames_of(
    fit: RigFit, nodes: list[Any], rotations: NDArray[np.float64], f: float
) -> RigFit:
    """The same sensors with the frames of other rotations (n, 3, 3), of another objective f.

    What frames and sensors could gain of that together is not known.
    """
    row = {node: k for k, node in enumerate(nodes)}
    of_sensor = fit.rotation_of
    frames: dict[Any, NDArray[np.float64]] = {}
    for node, (frame, sensor) in fit.images.items():
        if frame not in frames:
            frames[frame] = read_only(rotations[row[node]] @ of_sensor[sensor].T)
    return replace(fit, frames=frames, objective=f, lower_bound=None)

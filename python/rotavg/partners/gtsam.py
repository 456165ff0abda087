"""GTSAM: factor graphs of BetweenFactorRot3 or BetweenFactorPose3, and Values; pose family.

GTSAM's Rot3 and Pose3 are world_from_i, its between factors hold i_from_j: ours as they stand. Its
noise models put rotation first. A weight w becomes the information 2 w I of the rotation, and
information Omega the weight 3 / (2 tr(Omega^-1)), SE-Sync's kappa (Rosen et al. 2019).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, require
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.translations import RelativeTranslations
from rotavg.solving.positions import positions
from rotavg.solving.solution import Solution


def to_gtsam(item: MeasurementGraph | Solution) -> Any:
    """A graph as a `gtsam.NonlinearFactorGraph`, a solution as `gtsam.Values`.

    Where the graph has translations there are BetweenFactorPose3 and Pose3 (positions by
    `rotavg.positions`, which needs SciPy), else BetweenFactorRot3 and Rot3. Keys are the node ids.

    Raises:
        GraphError: ids that are no keys (names, negative numbers).
        MissingExtraError: gtsam is not installed.
    """
    gtsam = require("gtsam", "gtsam")
    if isinstance(item, MeasurementGraph):
        return _factors(gtsam, item)
    values = gtsam.Values()
    keys = _keys(item.graph)
    where = None if item.graph.translations is None else positions(item.graph, item.rotations)
    for k, key in enumerate(keys):
        R = gtsam.Rot3(item.rotations[k])
        values.insert(key, R if where is None else gtsam.Pose3(R, where[k]))
    return values


def from_gtsam(factors: Any) -> MeasurementGraph:
    """The graph of the between factors on Rot3 or Pose3 in a `gtsam.NonlinearFactorGraph`.

    Other factors, priors among them, are counted in the graph's notes. Of a robust noise model the
    Gaussian inside it counts.

    Raises:
        GraphError: there are no between factors, or factors of both kinds, or one whose noise model
            has no finite information.
        MissingExtraError: gtsam is not installed.
    """
    gtsam = require("gtsam", "gtsam")
    kinds: dict[type, list[Any]] = {gtsam.BetweenFactorPose3: [], gtsam.BetweenFactorRot3: []}
    skipped = 0
    for k in range(factors.size()):
        factor = factors.at(k)
        if type(factor) in kinds:
            kinds[type(factor)].append(factor)
        else:
            skipped += 1
    poses, turns = kinds.values()
    if bool(poses) == bool(turns):
        found = f"{len(poses)} BetweenFactorPose3 and {len(turns)} BetweenFactorRot3"
        raise GraphError(f"the factor graph has {found}, expected some of one kind")
    chosen = poses or turns
    information = np.array(
        [_information(factor.noiseModel(), k) for k, factor in enumerate(chosen)]
    )
    measured = [factor.measured() for factor in chosen]
    covariance = np.linalg.inv(information[:, :3, :3])
    weights = 1.5 / np.trace(covariance, axis1=1, axis2=2)
    return MeasurementGraph(
        [list(factor.keys()) for factor in chosen],
        [(m.rotation() if poses else m).matrix() for m in measured],
        weights,
        translations=RelativeTranslations(
            [m.translation() for m in measured], information[:, 3:, 3:]
        )
        if poses
        else None,
        notes=(f"{skipped} factors that are no between factors skipped",) if skipped else (),
    )


def _factors(gtsam: Any, graph: MeasurementGraph) -> Any:
    result = gtsam.NonlinearFactorGraph()
    keys = _keys(graph)
    moved = graph.translations
    for k, (i, j) in enumerate(graph.indices.tolist()):
        R = gtsam.Rot3(graph.rotations[k])
        information = 2 * graph.weights[k] * np.eye(3)
        if moved is None:
            noise = gtsam.noiseModel.Gaussian.Information(information)
            result.add(gtsam.BetweenFactorRot3(keys[i], keys[j], R, noise))
            continue
        both = np.zeros((6, 6))
        both[:3, :3], both[3:, 3:] = information, moved.information[k]
        pose = gtsam.Pose3(R, moved.vectors[k])
        noise = gtsam.noiseModel.Gaussian.Information(both)
        result.add(gtsam.BetweenFactorPose3(keys[i], keys[j], pose, noise))
    return result


def _keys(graph: MeasurementGraph) -> list[int]:
    ids = graph.nodes
    if ids.dtype.kind == "U" or (len(ids) > 0 and ids.min() < 0):
        found = ids[0].item() if ids.dtype.kind == "U" else ids.min().item()
        raise GraphError(f"found the node {found!r}, expected integers >= 0: GTSAM's keys are such")
    keys: list[int] = ids.tolist()
    return keys


def _information(noise: Any, factor: int) -> NDArray[np.float64]:
    """Information matrix of a noise model, robust or not."""
    if hasattr(noise, "noise"):
        noise = noise.noise()
    R = np.asarray(noise.R())
    information: NDArray[np.float64] = R.T @ R
    if not (np.isfinite(information).all() and np.linalg.det(R[:3, :3]) != 0):
        raise GraphError(f"between factor {factor} has a noise model without finite information")
    return information

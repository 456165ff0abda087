"""GTSAM: factor graphs of relative rotations or poses, priors, and Values; pose family.

GTSAM's rotations and poses are world_from_i, its between factors hold i_from_j: ours as they stand.
Its noise models put rotation first, but in the plane last. A weight w becomes the information 2 w I
of the rotation, and information Omega the weight 3 / (2 tr(Omega^-1)), SE-Sync's kappa (Rosen et
al. 2019). What is in the plane turns about z.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, require
from rotavg.graph.conventions import angles_about_z, matrices_from_angles_about_z
from rotavg.graph.covariances import information, not_used, of_information
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.translations import RelativeTranslations, first_not_positive_definite
from rotavg.io.pose_priors import PosePrior, in_plane, priors_of, weight_of
from rotavg.priors.priors import Priors
from rotavg.solving.known_poses import known_poses
from rotavg.solving.pose_refinement import PoseSolution
from rotavg.solving.solution import Solution

Floats = NDArray[np.float64]

_KINDS = ("Rot3", "Pose3", "Rot2", "Pose2")
_ROTATION = {"Rot3": slice(0, 3), "Pose3": slice(0, 3), "Rot2": slice(0, 1), "Pose2": slice(2, 3)}
_TRANSLATION = {"Pose3": slice(3, 6), "Pose2": slice(0, 2)}


def to_gtsam(item: MeasurementGraph | Solution | PoseSolution) -> Any:
    """A graph as a `gtsam.NonlinearFactorGraph`, a solution as `gtsam.Values`.

    Where the graph has translations there are BetweenFactorPose3 and Pose3, or in the plane
    BetweenFactorPose2 and Pose2, else BetweenFactorRot3 and Rot3. Positions are those that were
    refined or else fit best (`rotavg.positions`, which needs SciPy); after priors rotations and
    positions are in their world. Keys are the node ids.

    Raises:
        GraphError: ids that are no keys (names, negative numbers), or neither of these.
        MissingExtraError: gtsam is not installed.
    """
    gtsam = require("gtsam", "gtsam")
    if isinstance(item, MeasurementGraph):
        return _factors(gtsam, item)
    if not isinstance(item, (Solution, PoseSolution)):
        raise GraphError(f"found a {type(item).__name__}, expected a graph or a solution")
    values = gtsam.Values()
    keys = _keys(item.graph)
    rotations, where = np.asarray(item.rotations), None
    if isinstance(item, PoseSolution):
        where = item.positions
    elif item.graph.translations is not None:
        priors = Priors() if item.grounded is None else item.grounded.priors
        rotations, where = known_poses(item, {}, priors).start(item)
    for k, key in enumerate(keys):
        place = None if where is None else where[k]
        values.insert(key, _value(gtsam, item.graph, rotations[k], place))
    return values


def from_gtsam(factors: Any, *, skip_self_edges: bool = False) -> MeasurementGraph:
    """The graph of the measurements in a `gtsam.NonlinearFactorGraph`, or in a list.

    These are the between factors on Rot3, Pose3, Rot2 or Pose2, of one of these kinds. A list may
    hold factors as well as BinaryMeasurementRot3, as GTSFM hands them over. Priors become
    `rotavg.Priors` by `priors_from_gtsam`; what other factors there are is told in the graph's
    notes. Of a robust noise model the Gaussian inside it counts. A measurement without any
    information about the rotation is no edge, and told.

    Args:
        factors: a graph or a list.
        skip_self_edges: whether to leave out factors between a key and itself, instead of refusing
            them; the notes tell how many.

    Raises:
        GraphError: there are no measurements, or of several kinds, or one whose noise model has no
            finite information, or information about some directions alone.
        MissingExtraError: gtsam is not installed.
    """
    gtsam = require("gtsam", "gtsam")
    found: dict[str, list[_Measured]] = {kind: [] for kind in _KINDS}
    priors = others = 0
    for k, factor in enumerate(_list(factors)):
        kind = _kind(gtsam, "BetweenFactor", factor)
        if isinstance(factor, gtsam.BinaryMeasurementRot3):
            keys = [factor.key1(), factor.key2()]
            found["Rot3"].append(_measured("Rot3", keys, factor, f"measurement {k}"))
        elif kind is not None:
            found[kind].append(_measured(kind, list(factor.keys()), factor, f"between factor {k}"))
        elif _kind(gtsam, "PriorFactor", factor) is not None:
            priors += 1
        else:
            others += 1
    used = [kind for kind in _KINDS if found[kind]]
    if len(used) != 1:
        counts = ", ".join(f"{len(found[kind])} BetweenFactor{kind}" for kind in _KINDS)
        raise GraphError(f"the factor graph has {counts}, expected some of one kind")
    notes: tuple[str, ...] = ()
    if priors:
        notes += (f"{priors} prior factor{'s' * (priors > 1)} not in it: see priors_from_gtsam",)
    if others:
        notes += (f"{others} factor{'s' * (others > 1)} of other kinds skipped",)
    return _graph(used[0], found[used[0]], notes, skip_self_edges)


def priors_from_gtsam(factors: Any) -> Priors:
    """What the prior factors on Rot3, Pose3, Rot2 and Pose2 say, for `rotavg.solve`.

    A rotation becomes an absolute prior of the weight that its information has (one number: half
    the inverse of its mean variance), or where it is constrained a fixed rotation; the position of
    a pose one of `Priors.positions`, for `rotavg.refine_poses`, of the information 1e9 I if it is
    constrained. What the information about rotation and position shares is left out. Several of a
    node become one, which is the same up to a constant.

    Raises:
        GraphError: two priors of one node with different rotations, or information about some
            directions alone.
        MissingExtraError: gtsam is not installed.
    """
    gtsam = require("gtsam", "gtsam")
    found: list[PosePrior] = []
    for k, factor in enumerate(_list(factors)):
        kind = _kind(gtsam, "PriorFactor", factor)
        if kind is None:
            continue
        (node,) = factor.keys()
        told = _measured(kind, [node, node], factor, f"prior factor {k}", is_prior=True)
        about = np.zeros((3, 3))
        if kind in _TRANSLATION:
            block = _TRANSLATION[kind]
            about = told.omega[block, block]
            about = about if len(about) == 3 else in_plane(about)
            if not np.isinf(about).any():
                about = told.rotation @ about @ told.rotation.T
        turn = _about_rotation(told)
        found.append(PosePrior(node, told.what, None, told.rotation, turn, told.vector, about))
    return priors_of(found, lambda prior, reason: GraphError(f"{prior.place} {reason}"))


@dataclass(frozen=True)
class _Measured:
    """One factor: its keys, what it measures in space, and its information as GTSAM has it."""

    kind: str
    keys: list[int]
    rotation: Floats
    vector: Floats
    omega: Floats
    what: str


def _list(factors: Any) -> Iterable[Any]:
    if hasattr(factors, "at"):
        return (factors.at(k) for k in range(factors.size()))
    if isinstance(factors, (str, bytes)) or not isinstance(factors, Iterable):
        found = type(factors).__name__
        raise GraphError(f"found a {found}, expected a NonlinearFactorGraph or a list of factors")
    return factors


def _kind(gtsam: Any, name: str, factor: Any) -> str | None:
    """Which of the kinds a factor of this name is about; None if it is no such factor."""
    return next((k for k in _KINDS if type(factor) is getattr(gtsam, f"{name}{k}")), None)


def _measured(
    kind: str, keys: list[int], factor: Any, what: str, is_prior: bool = False
) -> _Measured:
    """Raises GraphError for information that is not finite; of a prior, rotation or position may be
    held: then it is infinite on the diagonal.
    """
    value = factor.prior() if hasattr(factor, "prior") else factor.measured()
    vector = np.zeros(3)
    if kind in _TRANSLATION:
        t = np.ravel(value.translation())
        vector[: len(t)] = t
        value = value.rotation()
    if kind in ("Rot2", "Pose2"):
        rotation = matrices_from_angles_about_z(np.array([[value.theta()]]))[0]
    else:
        rotation = np.asarray(value.matrix())
    size = {"Rot3": 3, "Pose3": 6, "Rot2": 1, "Pose2": 3}[kind]
    noise = factor.noiseModel()
    if is_prior and noise is not None and noise.isConstrained():
        omega = _constrained(kind, np.asarray(noise.sigmas()), what)
    else:
        omega = _information(noise, size, what)
    return _Measured(kind, keys, rotation, vector, omega, what)


def _graph(
    kind: str, measured: list[_Measured], notes: tuple[str, ...], skip_self_edges: bool
) -> MeasurementGraph:
    turn = _ROTATION[kind]
    omega = np.array([m.omega for m in measured])
    weights = np.array([_weight(m) for m in measured])
    rotation = omega[:, turn, turn]
    covariances: Floats | None = None
    if kind in ("Rot3", "Pose3"):
        covariances, bad_row = of_information(rotation, weights > 0)
        if bad_row is not None:
            notes += (not_used(f"of {measured[bad_row].what}"),)
    translations = None
    if kind in _TRANSLATION:
        move = _TRANSLATION[kind]
        cross = np.zeros((len(measured), 3, 3))
        size = move.stop - move.start
        cross[:, :size, 3 - (turn.stop - turn.start) :] = omega[:, move, turn]
        moved = np.array([m.omega[move, move] for m in measured])
        if size == 2:
            moved = np.array([in_plane(omega) for omega in moved])
        moved[weights == 0] = np.eye(3)  # of no edge
        bad = first_not_positive_definite(moved)
        if bad is None:
            translations = RelativeTranslations(
                [m.vector for m in measured],
                moved,
                cross=cross if cross.any() else None,
                dimension=size,
            )
        else:
            why = "has no definite information about them"
            notes += (f"translations not used: {measured[bad].what} {why}",)
    return MeasurementGraph(
        [m.keys for m in measured],
        [m.rotation for m in measured],
        weights,
        covariances=covariances,
        translations=translations,
        notes=notes,
        skip_self_edges=skip_self_edges,
    )


def _weight(measured: _Measured) -> float:
    """Of the rotation; 0 without information. GraphError for information that is not definite."""
    weight = weight_of(_about_rotation(measured))
    if np.isnan(weight):
        raise GraphError(f"{measured.what} has information about some rotations alone")
    return weight


def _about_rotation(measured: _Measured) -> Floats:
    """Information (3, 3) about the rotation; of what turns in the plane the same about all axes."""
    turn = _ROTATION[measured.kind]
    omega = measured.omega[turn, turn]
    return omega if len(omega) == 3 else np.diag(np.repeat(omega[0], 3))


def _constrained(kind: str, sigmas: Floats, what: str) -> Floats:
    """Information of which that about the rotation, or about the position, is infinite."""
    for block in (_ROTATION[kind], _TRANSLATION.get(kind, slice(0))):
        if len(set(sigmas[block] == 0)) > 1:
            raise GraphError(f"{what} holds some directions alone, expected all of them or none")
    return np.diag(np.where(sigmas == 0, np.inf, 1.0 / np.where(sigmas == 0, 1.0, sigmas) ** 2))


def _information(noise: Any, size: int, what: str) -> Floats:
    """Information matrix of a noise model, robust or not; the identity without one."""
    if noise is None:
        return np.eye(size)
    if hasattr(noise, "noise"):
        noise = noise.noise()
    with np.errstate(all="ignore"):
        R = np.asarray(noise.R())
        omega: Floats = R.T @ R
    if noise.isConstrained() or not np.isfinite(omega).all():
        raise GraphError(f"{what} has a noise model without finite information")
    return omega


def _value(gtsam: Any, graph: MeasurementGraph, rotation: Floats, where: Floats | None) -> Any:
    if where is None:
        return gtsam.Rot3(rotation)
    if graph.translations is not None and graph.translations.dimension == 2:
        return gtsam.Pose2(where[0], where[1], float(angles_about_z(rotation[None])[0, 0]))
    return gtsam.Pose3(gtsam.Rot3(rotation), where)


def _factors(gtsam: Any, graph: MeasurementGraph) -> Any:
    result = gtsam.NonlinearFactorGraph()
    keys = _keys(graph)
    moved = graph.translations
    turned = 2 * graph.weights[:, None, None] * np.eye(3)
    if graph.covariances is not None:
        turned = information(graph.covariances, np.ones(graph.num_edges))
        share = graph.weights * np.trace(graph.covariances, axis1=1, axis2=2) / 1.5
        if np.ptp(share) > 1e-9 * share.max():  # the weights are others
            turned = turned * share[:, None, None]
    gaussian = gtsam.noiseModel.Gaussian.Information
    for k, (i, j) in enumerate(graph.indices.tolist()):
        pair, R = (keys[i], keys[j]), graph.rotations[k]
        if moved is None:
            result.add(gtsam.BetweenFactorRot3(*pair, gtsam.Rot3(R), gaussian(turned[k])))
            continue
        both = np.zeros((6, 6))  # rotation first
        both[:3, :3], both[3:, 3:] = turned[k], moved.information[k]
        if moved.cross is not None:
            both[3:, :3], both[:3, 3:] = moved.cross[k], moved.cross[k].T
        measured = _value(gtsam, graph, R, moved.vectors[k])
        if moved.dimension == 2:
            plane = [3, 4, 2]
            noise = gaussian(both[np.ix_(plane, plane)])
            result.add(gtsam.BetweenFactorPose2(*pair, measured, noise))
        else:
            result.add(gtsam.BetweenFactorPose3(*pair, measured, gaussian(both)))
    return result


def _keys(graph: MeasurementGraph) -> list[int]:
    ids = graph.nodes
    if ids.dtype.kind == "U" or (len(ids) > 0 and ids.min() < 0):
        found = ids[0].item() if ids.dtype.kind == "U" else ids.min().item()
        raise GraphError(f"found the node {found!r}, expected integers >= 0: GTSAM's keys are such")
    keys: list[int] = ids.tolist()
    return keys

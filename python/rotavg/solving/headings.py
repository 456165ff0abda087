"""Frames that hang exactly as gravity says: only their headings are free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError, OptionError
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.grounded import cameras_of
from rotavg.priors.priors import Priors, Rigs, check_priors
from rotavg.solving.robust import RobustFit
from rotavg.solving.solution import Solution
from rotavg.solving.solve import solve

# Where the two ends of an edge differ so much in what is down that it hardly tells a heading.
_LEAST_SHARE = 1e-6
# As in the core (robust/scale.hpp).
_LEAST_NOISE = 1e-4
_TENTH_OF_HALF_NORMAL, _MEDIAN_BELOW_THREE = 0.1257, 0.6724
_SETTINGS = {
    *("method", "init", "seed", "tolerance", "stop", "max_iterations", "time_limit"),
    *("num_threads", "mu", "accelerate", "max_rank", "certify", "certificate_tolerance"),
    *("certificate_failure_probability", "certificate_seed", "certificate_max_flops", "callback"),
    *("loss", "loss_scale", "cycle_threshold", "min_cycles", "weight_kind"),
}


def trusted_weight(graph: MeasurementGraph) -> float:
    """A weight for gravity beside which edges hardly count, and yet can be proved."""
    degrees = np.bincount(graph.indices.ravel(), np.repeat(graph.weights, 2))
    return 1e3 * float(np.median(degrees))


def upright(gravity: ArrayLike, down: ArrayLike) -> NDArray[np.float64]:
    """The least rotation (3, 3) that takes the direction of gravity (3,) to down (3,)."""
    g, d = (np.asarray(v, dtype=np.float64) / np.linalg.norm(v) for v in (gravity, down))
    axis = np.cross(g, d)
    cosine = float(g @ d)
    if cosine < -1 + 1e-12:
        across = np.cross(g, np.eye(3)[int(np.argmin(np.abs(g)))])
        across /= np.linalg.norm(across)
        return np.asarray(2 * np.outer(across, across) - np.eye(3))
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1 + cosine))


@dataclass(frozen=True)
class _Headings:
    """The problem of headings alone: rotations about y between frames.

    Attributes:
        planar: its graph, of frames by number.
        frames: their ids, in that order.
        frame_of: (n,) numbers of the frames of the graph's nodes.
        tells: (m,) which edges of the graph are in it.
        tilt: (m,) by how much the two ends of an edge differ in what is down, a chord.
        upright: U_f (3, 3) of every frame.
        to_y: takes g to y.
    """

    planar: MeasurementGraph
    frames: list[Any]
    frame_of: NDArray[np.int64]
    tells: NDArray[np.bool_]
    tilt: NDArray[np.float64]
    upright: list[NDArray[np.float64]]
    to_y: NDArray[np.float64]

    def rotations(self, solution: Solution) -> list[NDArray[np.float64]]:
        """world_from_frame (3, 3) of every frame."""
        return [self.to_y.T @ solution[k] @ U for k, U in enumerate(self.upright)]


def _problem(
    graph: MeasurementGraph,
    rigs: Mapping[Any, tuple[Any, NDArray[np.float64]]],
    gravity: Mapping[Any, ArrayLike],
    down: ArrayLike,
) -> _Headings:
    """Rotations of frames whose gravity is held: R_f = exp(heading [g]) U_f, U_f d_f = g.

    Of an edge, U_i R_ij U_j^T = M, the part of tr(exp(delta [g]) M) that depends on the headings
    is rho cos(delta - phi): the problem is one of rotations about g alone, with the angles phi and
    the weights w rho / 2. As its edges are rotations about one axis, so is its solution, and what
    is proved of it is proved of the headings.
    """
    g = as_floats(down, (3,), "down")
    if not (np.isfinite(g).all() and g.any()):
        found = f"down is {g.tolist()}"
        raise GraphError(f"{found}, expected a finite direction other than zero")
    g = g / np.abs(g).max()
    g = g / np.linalg.norm(g)
    to_y = upright(g, (0.0, 1.0, 0.0))  # headings are turns about y there
    frames = list(gravity)
    row = {frame: k for k, frame in enumerate(frames)}
    U = [upright(d, (0.0, 1.0, 0.0)) for d in gravity.values()]
    nodes = graph.nodes.tolist()
    frame_of = np.array([row[rigs[node][0]] for node in nodes], dtype=np.int64)
    from_camera = np.array([U[f] @ rigs[node][1] for f, node in zip(frame_of, nodes)])
    i, j = graph.indices.T
    M = from_camera[i] @ graph.rotations @ np.swapaxes(from_camera[j], 1, 2)
    # tr(rot_y(delta) M) = M_yy + (M_xx + M_zz) cos(delta) + (M_zx - M_xz) sin(delta)
    along, across = M[:, 0, 0] + M[:, 2, 2], M[:, 2, 0] - M[:, 0, 2]
    rho, delta = np.hypot(along, across), np.arctan2(across, along)
    ends = frame_of[graph.indices]
    tells = (ends[:, 0] != ends[:, 1]) & (rho > _LEAST_SHARE)
    if not tells.any():
        raise GraphError("no edge between two frames tells a heading")
    turns = np.stack([np.zeros(len(delta)), -delta, np.zeros(len(delta))], axis=1)
    planar = MeasurementGraph.from_rotvecs(
        ends[tells], turns[tells], (0.5 * graph.weights * rho)[tells], np.arange(len(frames))
    )
    tilt = np.linalg.norm(M[:, :, 1] - np.array([0.0, 1.0, 0.0]), axis=1)  # of M e_y
    return _Headings(planar, frames, frame_of, tells, tilt, U, to_y)


def frame_headings(
    graph: MeasurementGraph,
    rigs: Mapping[Any, tuple[Any, NDArray[np.float64]]],
    gravity: Mapping[Any, ArrayLike],
    down: ArrayLike = (0.0, 1.0, 0.0),
    **settings: Any,
) -> dict[Any, NDArray[np.float64]]:
    """Rotations of frames whose gravity is held.

    Args:
        graph: the measurements between images.
        rigs: (frame, rotation C (3, 3) = rig_from_camera) of every image.
        gravity: down (3,) in every frame.
        down: g (3,), down in the world.
        settings: of `rotavg.solve`.

    Returns:
        world_from_frame (3, 3) of every frame.

    Raises:
        GraphError: no edge between two frames tells a heading.
    """
    headings = _problem(graph, rigs, gravity, down)
    if not isinstance(settings.get("init", "auto"), str):
        settings = {**settings, "init": "auto"}  # the problem is convex enough to start anew
    return dict(zip(headings.frames, headings.rotations(solve(headings.planar, **settings))))


def solve_headings(graph: MeasurementGraph, priors: Priors, **settings: Any) -> Solution:
    """Find the headings alone: every node (or frame of a calibrated rig) hangs as gravity says.

    Gravity is held exactly, whatever its weights, and of every rotation the angle about it is free:
    a problem of one unknown a node, with the certificate of `rotavg.solve` for the headings. With a
    robust loss outliers are told as ever: those whose headings contradict the rest, and those that
    gravity at their two ends refutes, whatever the headings; noise, threshold and robust objective
    are of the headings. Other answers that are possible are not looked for.

    Args:
        graph: the measurements.
        priors: gravity of every node, or of one node of every frame of `rigs`, which must all be
            known; `down`. Nothing else.
        settings: of `rotavg.solve`; not what is about known edges, covariances or the gauge.

    Returns:
        The solution, `upright`; its gradient is that of the headings. The first node of every
        component has the least rotation that takes its gravity down.

    Raises:
        GraphError: gravity of a node is not known; there is other prior knowledge; no edge tells a
            heading; and as `rotavg.solve` does.
        OptionError: an option that has no meaning here.
    """
    for name in settings:
        if name not in _SETTINGS:
            raise OptionError(f"{name} is not possible where headings alone are free")
    if not isinstance(settings.get("init", "auto"), str):
        raise OptionError("init: rotations are no start where headings alone are free")
    check_priors(priors)
    if priors.fixed or priors.absolute:
        raise GraphError("headings alone: expected gravity, and perhaps calibrated rigs")
    rigs, gravity = _of_frames(graph, priors)
    headings = _problem(graph, rigs, gravity, priors.down)
    refuted = _refuted_by_gravity(graph, headings, settings)
    if refuted.any():
        settings = {**settings, "excluded": refuted[headings.tells]}
    found = solve(headings.planar, **settings)
    of_frame = np.array(headings.rotations(found))
    C = np.array([rigs[node][1] for node in graph.nodes.tolist()])
    R = read_only(of_frame[headings.frame_of] @ C)
    there = solve(graph, init=R, max_iterations=0, certify=False)
    robust = (
        None if found.robust is None else _of_graph(graph, headings, found.robust, refuted, there)
    )
    weighted = graph if robust is None else graph.with_weights(robust.edge_weights)
    at = there if robust is None else solve(weighted, init=R, max_iterations=0, certify=False)
    return replace(
        there,
        rotations=R,
        objective=at.objective,
        component=read_only(found.component[headings.frame_of]),
        gradient_norm=found.gradient_norm,
        relative_gradient=found.relative_gradient,
        status=found.status,
        iterations=found.iterations,
        method=found.method,
        reason=found.reason,
        init=found.init,
        trace=found.trace,
        timings=found.timings,
        certificate=found.certificate,
        robust=robust,
        upright=True,
    )


def _of_frames(
    graph: MeasurementGraph, priors: Priors
) -> tuple[dict[Any, tuple[Any, NDArray[np.float64]]], dict[Any, NDArray[np.float64]]]:
    """Frame and rotation of every node, and down in every frame; those of no rig are their own."""
    own = {node: (("node", node), np.eye(3)) for node in graph.nodes.tolist()}
    rigs = cameras_of(priors.rigs) if isinstance(priors.rigs, Rigs) else priors.rigs
    for node, (frame, C) in rigs.items():
        own[node] = ("frame", frame), as_floats(C, (3, 3), f"the rotation of node {node!r}")
    keys = [key.item() if isinstance(key, np.generic) else key for key in priors.gravity]
    if not keys:
        raise GraphError("headings alone: expected the gravity of every node")
    rows = rows_of(as_ids(keys, "gravity"), graph.nodes)
    gravity: dict[Any, NDArray[np.float64]] = {}
    for row, key, (down, _) in zip(rows.tolist(), keys, priors.gravity.values()):
        vector = as_floats(down, (3,), f"the gravity prior of node {key!r}")
        if row < 0 or not (np.isfinite(vector).all() and vector.any()):
            found = "is not of the graph" if row < 0 else f"is {vector.tolist()}"
            raise GraphError(f"the gravity prior of node {key!r} {found}")
        frame, C = own[graph.nodes[row].item()]
        gravity.setdefault(frame, C @ vector)
    without = [node for node, (frame, _) in own.items() if frame not in gravity]
    if without:
        raise GraphError(
            f"gravity of {len(without)} of {len(own)} nodes is not known (say, {without[0]!r}), "
            "expected that of all where headings alone are free; as a prior it may lack"
        )
    frames = dict.fromkeys(frame for frame, _ in own.values())
    return own, {frame: gravity[frame] for frame in frames}


def _refuted_by_gravity(
    graph: MeasurementGraph, headings: _Headings, settings: Mapping[str, Any]
) -> NDArray[np.bool_]:
    """(m,) edges whose ends hang too differently for noise; none without a robust loss.

    A heavy edge is judged like one of the median weight: gravity errs, too, whatever the edges.
    The noise is told as that of `rotavg.solve` is (docs/robust.md): the fixed point s of s = median
    of those below 3 s (over that of a normal distribution), from the smallest tenth.
    """
    if settings.get("loss", "l2") == "l2":
        return np.zeros(graph.num_edges, bool)
    judged = headings.tilt.copy()
    if settings.get("weight_kind", "auto") != "frequency":
        judged *= np.sqrt(np.minimum(1.0, graph.weights / np.median(graph.weights)))
    r = np.sort(judged[headings.tells])
    noise = max(_LEAST_NOISE, float(r[len(r) // 10]) / _TENTH_OF_HALF_NORMAL)
    for _ in range(100):
        below = int(np.searchsorted(r, 3 * noise, side="right"))
        last, noise = noise, max(_LEAST_NOISE, float(r[below // 2]) / _MEDIAN_BELOW_THREE)
        if abs(noise - last) <= 1e-9 * noise:
            break
    scale = settings.get("loss_scale", "auto")
    return np.asarray(judged > max(3 * noise, 0.0 if isinstance(scale, str) else float(scale)))


def _of_graph(
    graph: MeasurementGraph,
    headings: _Headings,
    fit: RobustFit,
    refuted: NDArray[np.bool_],
    there: Solution,
) -> RobustFit:
    """What a loss made of the headings' edges, for those of the graph."""
    tells = headings.tells
    scales, weights = np.ones(graph.num_edges), np.array(graph.weights)
    scales[tells] = fit.edge_scales
    favoured = np.zeros(graph.num_edges, dtype=np.bool_)
    favoured[tells] = fit.is_favoured
    weights[tells] *= fit.edge_weights / headings.planar.weights
    chords = 2 * np.sin(0.5 * there.residual_angles)
    verdicts = np.where(chords <= fit.threshold, "inlier", "robust_weight")
    verdicts = verdicts.astype(np.result_type(verdicts, fit.edge_verdicts))
    verdicts[tells] = fit.edge_verdicts
    ends = fit.part[headings.frame_of][graph.indices]
    apart = ends[:, 0] != ends[:, 1]
    verdicts[refuted] = np.where(apart[refuted], "weak_part", "robust_weight")
    weights[~tells & (verdicts != "inlier")] *= _LEAST_SHARE
    return replace(
        fit,
        edge_weights=read_only(weights),
        edge_scales=read_only(scales),
        is_favoured=read_only(favoured),
        edge_verdicts=read_only(verdicts),
        part=read_only(fit.part[headings.frame_of]),
        alternatives=(),
    )

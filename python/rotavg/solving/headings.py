"""Frames that hang exactly as gravity says: only their headings are free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import GraphError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.solve import solve

# Where the two ends of an edge differ so much in what is down that it hardly tells a heading.
_LEAST_SHARE = 1e-6


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


def solve_headings(
    graph: MeasurementGraph,
    rigs: Mapping[Any, tuple[Any, NDArray[np.float64]]],
    gravity: Mapping[Any, ArrayLike],
    down: ArrayLike = (0.0, 1.0, 0.0),
    **settings: Any,
) -> dict[Any, NDArray[np.float64]]:
    """Rotations of frames whose gravity is held: R_f = exp(heading [g]) U_f, U_f d_f = g.

    Of an edge, U_i R_ij U_j^T = M, the part of tr(exp(delta [g]) M) that depends on the headings
    is rho cos(delta - phi): the problem is one of rotations about g alone, with the angles phi and
    the weights w rho / 2. As its edges are rotations about one axis, so is its solution, and what
    is proved of it is proved of the headings.

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
    g = np.asarray(down, dtype=np.float64) / np.linalg.norm(down)
    to_y = upright(g, (0.0, 1.0, 0.0))  # headings are turns about y there
    frame_of = {node: frame for node, (frame, _) in rigs.items()}
    U = {frame: upright(d, (0.0, 1.0, 0.0)) for frame, d in gravity.items()}
    from_camera = {node: U[frame] @ C for node, (frame, C) in rigs.items()}
    i, j = graph.edges.T.tolist()
    M = np.array([from_camera[a] @ R @ from_camera[b].T for a, R, b in zip(i, graph.rotations, j)])
    # tr(rot_y(delta) M) = M_yy + (M_xx + M_zz) cos(delta) + (M_zx - M_xz) sin(delta)
    along, across = M[:, 0, 0] + M[:, 2, 2], M[:, 2, 0] - M[:, 0, 2]
    rho, delta = np.hypot(along, across), np.arctan2(across, along)
    frames = list(gravity)
    row = {frame: k for k, frame in enumerate(frames)}
    ends = np.array([[row[frame_of[a]], row[frame_of[b]]] for a, b in zip(i, j)])
    tells = (ends[:, 0] != ends[:, 1]) & (rho > _LEAST_SHARE)
    if not tells.any():
        raise GraphError("no edge between two frames tells a heading")
    turns = np.stack([np.zeros(len(delta)), -delta, np.zeros(len(delta))], axis=1)
    planar = MeasurementGraph.from_rotvecs(
        ends[tells], turns[tells], (0.5 * graph.weights * rho)[tells], np.arange(len(frames))
    )
    if not isinstance(settings.get("init", "auto"), str):
        settings = {**settings, "init": "auto"}  # the problem is convex enough to start anew
    solution = solve(planar, **settings)
    return {frame: to_y.T @ solution[k] @ U[frame] for frame, k in row.items()}

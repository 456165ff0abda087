"""Trajectories and orientations, before and after."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, require
from rotavg.drawing import figures, places
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.plot.canvas import COLOURS, axes_3d

_EDGES, _FRAMES = 20000, 200  # the most that are drawn
_AXIS_COLOURS = ("tab:red", "tab:green", "tab:blue")


def trajectory(
    graph: MeasurementGraph,
    rotations: ArrayLike,
    ax: Any | None = None,
    *,
    positions: ArrayLike | None = None,
    top_deg: float | None = None,
) -> Any:
    """Poses in space: nodes coloured by the mean residual of their edges, and some frames.

    Args:
        graph: the measurements.
        rotations: (n, 3, 3) world_from_node; those before and those after make two pictures.
        ax: axes with projection="3d"; a new figure's by default.
        positions: (n, 3); by default those that fit the relative translations best, given these
            rotations, or else those in the file that the graph was read from.
        top_deg: end of the colour scale, degrees, so that two pictures can share it.

    Raises:
        GraphError: there are no positions, or arrays of the wrong shape.
        MissingExtraError: Matplotlib is not installed.
    """
    drawn = axes_3d(ax)
    place = _positions(graph, rotations, positions)
    residuals = figures.residuals_deg(graph, rotations)
    lines = require("mpl_toolkits.mplot3d.art3d", "plot").Line3DCollection
    shown = figures.evenly(graph.num_edges, _EDGES)
    segments = place[graph.indices[shown]]
    drawn.add_collection3d(lines(segments, colors="0.8", linewidths=0.4, rasterized=True))
    _dots(drawn, place, figures.node_means(graph, residuals), top_deg)
    kept = figures.evenly(graph.num_nodes, _FRAMES)
    R = np.asarray(rotations, dtype=np.float64)[kept]
    frames = places.axes_of_frames(place[kept], R, 0.7 * places.spacing(graph, place))
    for segments, colour in zip(frames, _AXIS_COLOURS):
        drawn.add_collection3d(lines(segments, colors=colour, linewidths=0.8))
    low, high = place.min(axis=0), place.max(axis=0)
    drawn.set(xlim=_widened(low, high, 0), ylim=_widened(low, high, 1), zlim=_widened(low, high, 2))
    drawn.set_aspect("equal")
    drawn.set(xlabel="x", ylabel="y", zlabel="z")
    drawn.set_title(f"mean residual {np.mean(residuals):.3g} deg")
    return drawn


def orientations(
    graph: MeasurementGraph,
    rotations: ArrayLike,
    ax: Any | None = None,
    *,
    top_deg: float | None = None,
) -> Any:
    """Where the nodes look: the z axis of each as a point on the unit sphere.

    The points are coloured by the mean residual of a node's edges. Turns about the z axis do not
    show. Arguments and errors are those of `trajectory`.
    """
    drawn = axes_3d(ax)
    residuals = figures.residuals_deg(graph, rotations)
    directions = np.asarray(rotations, dtype=np.float64)[:, :, 2]
    turn, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    drawn.plot_wireframe(
        np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt),
        color="0.85", linewidth=0.4,
    )  # fmt: skip
    _dots(drawn, directions, figures.node_means(graph, residuals), top_deg)
    drawn.set_aspect("equal")
    drawn.set(xlabel="x", ylabel="y", zlabel="z")
    drawn.set_title(f"viewing directions; mean residual {np.mean(residuals):.3g} deg")
    return drawn


def _positions(
    graph: MeasurementGraph, rotations: ArrayLike, given: ArrayLike | None
) -> NDArray[np.float64]:
    if given is not None:
        return as_floats(given, (graph.num_nodes, 3), "positions")
    found = places.positions_of(graph, rotations)
    if found is None:
        raise GraphError(
            "the graph has no translations, and its file no positions of all nodes: "
            "pass positions=, or draw orientations()"
        )
    return found[0]


def _dots(
    ax: Any, points: NDArray[np.float64], values: NDArray[np.float64], top: float | None
) -> None:
    dots = ax.scatter(
        *points.T,
        c=values,
        s=max(1.0, 12.0 * min(1.0, 1000 / len(points))),
        cmap=COLOURS,
        vmin=0,
        vmax=figures.top_of_scale(values) if top is None else top,
        depthshade=False,
        rasterized=True,
    )
    label = "mean residual angle at a node [deg]"
    ax.figure.colorbar(dots, ax=ax, label=label, extend="max", shrink=0.7, pad=0.1)


def _widened(low: NDArray[np.float64], high: NDArray[np.float64], axis: int) -> tuple[float, float]:
    """Limits along an axis; a flat trajectory gets some height."""
    middle = (low[axis] + high[axis]) / 2
    half = max(high[axis] - low[axis], 0.1 * float((high - low).max())) / 2
    return middle - half, middle + half

"""The figure in space: poses where positions are known, directions on a sphere where not."""

from __future__ import annotations

import html
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.drawing import figures, places
from rotavg.report.style import COLOUR_BAR, COLOURS, MUTED
from rotavg.solving.solution import Solution

_NODES, _EDGES, _FRAMES, _NAMES = 30000, 8000, 250, 10000  # the most that are drawn, or named


def space(solution: Solution) -> tuple[Any, str]:
    """The figure, and a sentence that says what it shows and what was left out."""
    figure = require("plotly.graph_objects", "report").Figure()
    found = places.positions_of(solution.graph, solution.rotations)
    if found is None:
        said = _draw_sphere(figure, solution)
        scene = _scene(np.array([[-1.0] * 3, [1.0] * 3]))
    else:
        positions, source = found
        said = _draw_poses(figure, solution, positions) + " " + source
        scene = _scene(positions)
    figure.update_layout(scene=scene, showlegend=False, margin={"l": 0, "r": 0, "t": 36, "b": 0})
    return figure, said


def _scene(points: NDArray[np.float64]) -> dict[str, Any]:
    """A box around points (k, 3), of equal scale along all axes, and seen as a whole."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max())
    side = high - low + 2 * margin
    axes = {
        f"{name}axis": {
            "range": [float(low[k] - margin), float(high[k] + margin)],
            "showbackground": False, "showspikes": False, "zeroline": False,
        }
        for k, name in enumerate("xyz")
    }  # fmt: skip
    return {
        **axes,
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", (side / side.max()).tolist())),
        "camera": {"eye": {"x": 1.0, "y": 1.0, "z": 0.7}},
    }


def _draw_poses(figure: Any, solution: Solution, positions: NDArray[np.float64]) -> str:
    graph = solution.graph
    degrees = np.degrees(solution.residual_angles)
    shown = figures.worst_and_others(degrees, _EDGES)
    _draw_segments(
        figure,
        positions[graph.indices[shown]],
        {
            "color": np.repeat(degrees[shown], 3).astype(np.float32),
            "colorscale": COLOURS, "cmin": 0, "cmax": figures.top_of_scale(degrees), "width": 2,
        },
    )  # fmt: skip
    _draw_nodes(figure, solution, positions)
    kept = figures.evenly(graph.num_nodes, _FRAMES)
    frames = places.axes_of_frames(
        positions[kept], solution.rotations[kept], 0.6 * places.spacing(graph, positions)
    )
    for segments, colour in zip(frames, ("#d64541", "#3aa655", "#3b7dd8")):
        _draw_segments(figure, segments, {"color": colour, "width": 3})
    said = (
        "Every dot is a pose, coloured by the mean residual of its edges; lines are edges, by "
        "their own. The small frames are the solved rotations (x red, y green, z blue)."
    )
    if len(shown) < graph.num_edges:
        said += f" Drawn are {len(shown)} of {graph.num_edges} edges, the worst among them."
    return said + _nodes_left_out(solution)


def _draw_sphere(figure: Any, solution: Solution) -> str:
    around = np.linspace(0, 2 * np.pi, 61)
    rings = []
    for tilt in np.radians(np.arange(30, 180, 30)):
        ring = [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around)]
        rings.append(np.column_stack([*ring, np.full(61, np.cos(tilt))]))
    for turn in np.radians(np.arange(0, 180, 30)):
        ring = [np.sin(around) * np.cos(turn), np.sin(around) * np.sin(turn), np.cos(around)]
        rings.append(np.column_stack(ring))
    lines = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    _draw_segments(figure, lines, {"color": MUTED, "width": 1})
    _draw_nodes(figure, solution, solution.rotations[:, :, 2])
    frame, gauge = "frame of the first node", "every component in its own gauge"
    if solution.grounded is not None:
        frame, gauge = "world of the priors", "components that they do not hold in their own gauge"
    gauge = f" ({gauge})" if solution.num_components > 1 else ""
    return (
        f"Every dot is a node: where its z axis points in the {frame}{gauge}, "
        "coloured by the mean residual of its edges. The input has no positions; turns about the "
        "z axis do not show." + _nodes_left_out(solution)
    )


def _draw_nodes(figure: Any, solution: Solution, points: NDArray[np.float64]) -> None:
    graph = solution.graph
    means = figures.node_means(graph, np.degrees(solution.residual_angles))
    kept = figures.evenly(graph.num_nodes, _NODES)
    named = len(kept) <= _NAMES
    x, y, z = points[kept].astype(np.float32).T
    figure.add_scatter3d(
        x=x, y=y, z=z,
        mode="markers",
        # Plotly takes a few tags in texts for markup.
        text=[html.escape(str(name)) for name in graph.nodes[kept].tolist()] if named else None,
        hovertemplate=("%{text}: " if named else "") + "%{marker.color:.3g} deg<extra></extra>",
        marker={
            "size": float(np.clip(110 / np.sqrt(len(kept)), 1.5, 5)),
            "color": means[kept].astype(np.float32),
            "colorscale": COLOURS,
            "cmin": 0,
            "cmax": figures.top_of_scale(means),
            "line": {"width": 0},
            "colorbar": COLOUR_BAR,
        },
    )  # fmt: skip


def _draw_segments(figure: Any, segments: NDArray[np.float64], line: dict[str, Any]) -> None:
    """Draw segments (k, 2, 3) as one line that has a gap after each."""
    gapped = np.full((len(segments), 3, 3), np.nan, dtype=np.float32)
    gapped[:, :2] = segments
    x, y, z = gapped.reshape(-1, 3).T
    figure.add_scatter3d(x=x, y=y, z=z, mode="lines", line=line, hoverinfo="skip")


def _nodes_left_out(solution: Solution) -> str:
    n = solution.graph.num_nodes
    return f" Drawn are {_NODES} of {n} nodes, evenly chosen." if n > _NODES else ""

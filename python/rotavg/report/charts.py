"""The flat figures of the page, by Plotly: residuals, convergence, adjacency."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.drawing import figures
from rotavg.report.style import COLOUR_BAR, COLOURS, MUTED, SECOND, THIRD
from rotavg.report.verdict import is_reweighted
from rotavg.solving.kept import kept_degrees
from rotavg.solving.solution import Solution

_BINS, _POINTS, _CELLS = 80, 1500, 250


def residuals(solution: Solution) -> Any:
    """Histogram of the residual angles; beside it, where weights changed, what is left of them."""
    go = require("plotly.graph_objects", "report")
    degrees = np.degrees(solution.residual_angles)
    counts, edges = np.histogram(degrees, _BINS, range=(0, max(float(degrees.max()), 1e-12)))
    middle, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    figure = go.Figure()
    figure.add_bar(
        x=middle, y=counts, width=width, name="edges", marker={"color": MUTED, "line_width": 0},
        hovertemplate="%{x:.3g} deg: %{y} edges<extra></extra>",
    )  # fmt: skip
    if is_reweighted(solution):
        kept = solution.edge_weights / solution.graph.weights
        left, _ = np.histogram(degrees, edges, weights=kept / kept.max())
        figure.add_bar(
            x=middle, y=left, width=width, name="edges, by what is left of their weight",
            marker={"color": SECOND, "line_width": 0},
            hovertemplate="%{x:.3g} deg: %{y:.4g} left<extra></extra>",
        )  # fmt: skip
    median = float(np.median(kept_degrees(solution)))
    figure.add_vline(median, line={"color": THIRD, "width": 1.5})
    # Where a few bins hold nearly all, a linear axis would hide the others.
    log = counts.max() > 200 * np.median(counts[counts > 0])
    figure.update_layout(
        barmode="overlay", xaxis_title="residual angle [deg]",
        yaxis={"title": "edges", "type": "log" if log else "linear"},
        legend={"x": 1, "xanchor": "right", "y": 1},
    )  # fmt: skip
    return figure


def convergence(solution: Solution) -> Any:
    """Objective above the best, and relative gradient, against time."""
    go = require("plotly.graph_objects", "report")
    trace = solution.trace
    kept = _thinned(len(trace))
    excess = figures.relative_excess(trace.objective)
    figure = go.Figure()
    for values, colour, axis in (
        (excess, SECOND, "y"),
        (trace.relative_gradient, THIRD, "y2"),
    ):
        figure.add_scatter(
            x=1e3 * trace.seconds[kept],
            y=np.maximum(values[kept], 1e-17),
            customdata=kept,
            yaxis=axis,
            mode="lines+markers" if len(kept) < 200 else "lines",
            line={"color": colour},
            hovertemplate="iteration %{customdata}, %{x:.4g} ms: %{y:.3g}<extra></extra>",
        )
    objective, gradient = (
        log_axis(np.maximum(values[kept], 1e-17)) for values in (excess, trace.relative_gradient)
    )
    figure.update_layout(
        xaxis_title="time [ms]",
        yaxis={**objective, "title": _title("objective above the best, relative", SECOND)},
        yaxis2={
            **gradient, "title": _title("relative gradient [rad]", THIRD),
            "overlaying": "y", "side": "right", "showgrid": False, "automargin": True,
        },
        showlegend=False,
    )  # fmt: skip
    return figure


def adjacency(solution: Solution) -> Any:
    """Adjacency matrix, in cells that show the largest residual of the edges in them."""
    go = require("plotly.graph_objects", "report")
    degrees = np.degrees(solution.residual_angles)
    picture = figures.largest_in_cells(solution.graph, degrees, _CELLS)
    n, side = solution.graph.num_nodes, len(picture)
    figure = go.Figure()
    figure.add_heatmap(
        z=picture.astype(np.float32),
        x0=n / side / 2 - 0.5,
        dx=n / side,
        y0=n / side / 2 - 0.5,
        dy=n / side,
        zmin=0,
        zmax=figures.top_of_scale(degrees),
        colorscale=COLOURS,
        hoverongaps=False,
        colorbar=COLOUR_BAR,
        hovertemplate="row %{y:.0f}, column %{x:.0f}: %{z:.3g} deg<extra></extra>",
    )
    figure.update_layout(
        xaxis={
            "title": "node (in the order of the input)",
            "constrain": "domain",
            "tickformat": "d",
        },
        yaxis={
            "autorange": "reversed",
            "tickformat": "d",
            "scaleanchor": "x",
            "constrain": "domain",
        },
    )
    return figure


def log_axis(values: NDArray[np.float64]) -> dict[str, Any]:
    """A logarithmic axis for these positive values, with ticks at powers of ten if they span two.

    (Left alone, Plotly crowds it with the digits between.)
    """
    decades = float(np.log10(values.max() / values.min()))
    return {"type": "log", "dtick": int(np.ceil(decades / 8))} if decades > 2 else {"type": "log"}


def _title(text: str, colour: str) -> dict[str, Any]:
    return {"text": text, "font": {"color": colour}}


def _thinned(count: int) -> NDArray[np.int64]:
    """Iterations that are drawn: the first ones densely, as there most happens."""
    if count <= _POINTS:
        return np.arange(count)
    return np.unique(np.geomspace(1, count, _POINTS).round().astype(np.int64)) - 1

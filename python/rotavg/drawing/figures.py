"""Figures of edges and nodes for pictures, and which of many things are drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.graph.measurement_graph import MeasurementGraph

_ROUNDING_DEG = 1e-9  # residuals below this are zero to the eye: no colours for rounding


def residuals_deg(graph: MeasurementGraph, rotations: ArrayLike) -> NDArray[np.float64]:
    """Angle (m,) between R_i R_ij and R_j of every edge, degrees, at rotations (n, 3, 3)."""
    R = as_floats(rotations, (graph.num_nodes, 3, 3), "rotations")
    return np.degrees(_core.residual_angles(graph._core, R))


def node_means(graph: MeasurementGraph, of_edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean (n,) over the edges at every node of figures (m,) of edges; 0 at a node without one."""
    ends = graph.indices.ravel()
    total = np.bincount(ends, weights=np.repeat(of_edges, 2), minlength=graph.num_nodes)
    degree = np.bincount(ends, minlength=graph.num_nodes)
    return np.asarray(total / np.maximum(degree, 1))


def top_of_scale(values: NDArray[np.float64]) -> float:
    """Where a colour scale of degrees ends: a few outliers do not make all else look alike."""
    top = float(np.percentile(values, 99))
    return max(top if top > 0 else float(values.max()), _ROUNDING_DEG)


def relative_excess(objective: NDArray[np.float64]) -> NDArray[np.float64]:
    """Objective (k,) above the best one, relative to it, or to the worst one if that is zero."""
    best = float(objective.min())
    scale = best if best > 0 else float(objective.max()) or 1.0
    return np.asarray((objective - best) / scale)


def largest_in_cells(
    graph: MeasurementGraph, of_edges: NDArray[np.float64], cells: int
) -> NDArray[np.float64]:
    """Adjacency matrix of at most `cells` rows: the largest of the edges' figures in every cell.

    NaN where there is no edge. Several nodes share a row where there are more nodes than cells.
    """
    n = graph.num_nodes
    side = min(n, cells)
    i, j = graph.indices.astype(np.int64).T * side // n
    picture = np.full((side, side), -np.inf)
    np.maximum.at(picture, (i, j), of_edges)
    np.maximum.at(picture, (j, i), of_edges)
    return np.where(np.isfinite(picture), picture, np.nan)


def evenly(count: int, limit: int) -> NDArray[np.int64]:
    """At most `limit` of the rows 0 ... count - 1, evenly spread."""
    return np.linspace(0, count - 1, min(count, limit)).round().astype(np.int64)


def worst_and_others(values: NDArray[np.float64], limit: int) -> NDArray[np.int64]:
    """Rows of at most `limit` values, ascending by value: the largest quarter of what is drawn, and
    an even choice of the others. What is drawn last, on top, is the worst.
    """
    order = np.argsort(values, kind="stable")
    if len(values) <= limit:
        return order
    worst = limit // 4
    others = np.sort(order[:-worst])
    kept = others[evenly(len(others), limit - worst)]
    return np.concatenate([kept[np.argsort(values[kept], kind="stable")], order[-worst:]])

"""Which nodes are joined, and how badly their measurements fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotavg.drawing import figures
from rotavg.plot.canvas import COLOURS, axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rotavg.solving.solution import Solution


def adjacency(solution: Solution, ax: Axes | None = None, *, cells: int = 300) -> Axes:
    """Adjacency matrix, every edge coloured by its residual angle in degrees.

    Args:
        solution: whose graph and residuals.
        ax: axes to draw into; a new figure's by default.
        cells: largest number of cells along a side. Where there are more nodes, a cell stands for
            the edges between several of them and shows the largest residual.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    drawn = axes(ax)
    n = solution.graph.num_nodes
    degrees = np.degrees(solution.residual_angles)
    image = drawn.imshow(
        figures.largest_in_cells(solution.graph, degrees, cells),
        cmap=COLOURS,
        vmin=0,
        vmax=figures.top_of_scale(degrees),
        extent=(-0.5, n - 0.5, n - 0.5, -0.5),
        interpolation="nearest",
    )
    largest = "largest residual angle" if n > cells else "residual angle"
    drawn.figure.colorbar(image, ax=drawn, label=f"{largest} [deg]", extend="max", shrink=0.8)
    drawn.set(xlabel="node (row of graph.nodes)", ylabel="node (row of graph.nodes)")
    drawn.set_title(f"{solution.graph.num_edges} edges of {n} nodes")
    return drawn

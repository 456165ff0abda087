"""What the measurements leave over."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotavg.plot.canvas import axes
from rotavg.solving.kept import kept_degrees

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rotavg.solving.solution import Solution

_WIDE = 30.0  # largest over median residual, from which on the scale is logarithmic


def residuals(solution: Solution, ax: Axes | None = None, *, bins: int = 60) -> Axes:
    """Histogram of the edges' residual angles, degrees.

    Where a robust loss has changed the weights, a second histogram counts every edge by what is
    left of its weight (relative to the edge that kept most).

    Args:
        solution: whose residuals.
        ax: axes to draw into; a new figure's by default.
        bins: number of bins.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    drawn = axes(ax)
    degrees = np.degrees(solution.residual_angles)
    median, top = float(np.median(degrees)), max(float(degrees.max()), 1e-12)
    if median > 0 and top > _WIDE * median:
        low = max(float(np.percentile(degrees, 1)), 1e-4 * median)
        edges = np.geomspace(low, top, bins + 1).tolist()
        drawn.set_xscale("log")
    else:
        edges = np.linspace(0, top, bins + 1).tolist()
    shown = np.clip(degrees, edges[0], edges[-1])
    kept = solution.edge_weights / solution.graph.weights
    kept = kept / kept.max()
    drawn.hist(shown, edges, color="0.75", label=f"{len(degrees)} edges")
    if kept.min() < 1 - 1e-9:
        label = f"by what is left of their weight: {kept.sum():.0f}"
        drawn.hist(shown, edges, weights=kept, color="tab:blue", label=label)
    middle = float(np.median(kept_degrees(solution)))
    of_kept = "" if solution.robust is None else " (edges kept)"
    drawn.axvline(middle, color="tab:red", linewidth=1, label=f"median {middle:.3g} deg{of_kept}")
    drawn.set(xlabel="residual angle [deg]", ylabel="edges", title="Residuals")
    drawn.legend()
    return drawn

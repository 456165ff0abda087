"""How the objective and the gradient fell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotavg.drawing import figures
from rotavg.plot.canvas import axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rotavg.solving.solution import Solution

_ROUNDING = 1e-16


def convergence(solution: Solution, ax: Axes | None = None) -> Axes:
    """Objective above the best that was reached, and relative gradient, against time.

    Args:
        solution: whose trace.
        ax: axes to draw into, which get a twin for the gradient; a new figure's by default.

    Returns:
        The axes of the objective.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    drawn = axes(ax)
    trace = solution.trace
    milliseconds = 1e3 * trace.seconds
    excess = np.maximum(figures.relative_excess(trace.objective), _ROUNDING)
    style = {"linewidth": 1.2, "marker": "o", "markersize": 3 if len(trace) <= 200 else 0}
    drawn.semilogy(milliseconds, excess, color="tab:blue", **style)
    drawn.set(
        xlabel="time [ms]",
        title=f"{solution.method}: {solution.iterations} iterations from {solution.init}",
    )
    drawn.set_ylabel("objective above the best, relative", color="tab:blue")
    drawn.grid(alpha=0.3)
    other = drawn.twinx()
    gradient = np.maximum(trace.relative_gradient, _ROUNDING)
    other.semilogy(milliseconds, gradient, color="tab:orange", **style)
    other.set_ylabel("relative gradient [rad]", color="tab:orange")
    return drawn

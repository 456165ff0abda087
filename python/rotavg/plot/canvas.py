"""Axes to draw into."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rotavg.base.errors import OptionError, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = "plasma"  # of residuals, everywhere


def axes(ax: Axes | None) -> Axes:
    """`ax`, or that of a new figure. Raises MissingExtraError without Matplotlib."""
    plt = require("matplotlib.pyplot", "plot")
    if ax is None:
        ax = plt.figure(layout="constrained").add_subplot()
    return ax


def axes_3d(ax: Any | None) -> Any:
    """`ax`, or that of a new figure; OptionError for axes without a third dimension."""
    plt = require("matplotlib.pyplot", "plot")
    if ax is None:
        return plt.figure(layout="constrained").add_subplot(projection="3d")
    if not hasattr(ax, "get_zlim"):
        raise OptionError('ax is flat; expected axes made with projection="3d"')
    return ax

"""Figures as a paper has them: one look, labelled, as PNG and PDF. Needs matplotlib."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rotavg.base.errors import require

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 7.0  # inches: both columns of a page
COLOURS = {"BCD": "#0072b2", "SUM": "#d55e00", "SUM, adaptive µ": "#009e73", "BCDSR": "#7b3294"}
_STYLE = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "legend.fontsize": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.3,
    "mathtext.fontset": "stix",
    "pdf.fonttype": 42,  # text stays text
}


def pictures(draw: Callable[[Figure], None], height: float) -> dict[str, bytes]:
    """What `draw` draws on an empty figure, `height` inches high, as "png" and "pdf".

    Raises MissingExtraError without matplotlib.
    """
    mpl = require("matplotlib", "plot")
    figures = require("matplotlib.figure", "plot")
    with mpl.rc_context():
        mpl.rcdefaults()  # whatever style the user prefers
        mpl.rcParams.update(_STYLE)
        figure: Figure = figures.Figure(figsize=(WIDTH, height), layout="constrained")
        draw(figure)
        return {"png": _saved(figure, "png", dpi=200), "pdf": _saved(figure, "pdf")}


def _saved(figure: Figure, suffix: str, **options: Any) -> bytes:
    stream = io.BytesIO()
    # No date, so that the same figure has the same bytes.
    metadata = {"CreationDate": None} if suffix == "pdf" else {"Software": None}
    figure.savefig(stream, format=suffix, metadata=metadata, **options)
    return stream.getvalue()

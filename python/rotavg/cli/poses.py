"""Poses refined as a whole, for `rotavg solve`."""

from __future__ import annotations

from pathlib import Path

import rotavg
from rotavg.base.errors import require


def check_refinable(path: Path, graph: rotavg.MeasurementGraph) -> None:
    """Raise what `rotavg.refine_poses` would raise, as far as it can be told before the work."""
    require("scipy.sparse.linalg", "scipy")
    if graph.translations is None:
        found = "the graph has no relative translations"
        raise rotavg.FormatError(f"{found}: there are no poses to refine", path=path)

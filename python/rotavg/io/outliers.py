"""Pose graphs that are written without the edges that a robust loss has rejected."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from rotavg.base.errors import FormatError, IncompleteWarning
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.registry import Format, WithoutOutliers, Writable


def check_drops_outliers(formats: Sequence[Format], path: Path, form: Format) -> None:
    """FormatError for a format whose files of solutions hold no edges."""
    if form.has_positions and form.has_translations:
        return
    able = ", ".join(f.name for f in formats if f.has_positions and f.has_translations)
    raise FormatError(
        f"outliers are to be left out, and {form.name} holds no edges: expected {able}", path=path
    )


def without_outliers(
    formats: Sequence[Format], path: Path, form: Format, item: Writable
) -> Writable:
    """What is written of a solution, less the edges that a robust loss has rejected.

    Raises:
        FormatError: a format without edges, or no solution.
    """
    check_drops_outliers(formats, path, form)
    if isinstance(item, MeasurementGraph) or not hasattr(item, "inlier_graph"):
        found = type(item).__name__
        raise FormatError(
            f"found a {found} without outliers to drop, expected a Solution", path=path
        )
    kept: MeasurementGraph = item.inlier_graph
    parts, before = (int(g.components().max()) + 1 for g in (kept, item.graph))
    if parts > before:
        warnings.warn(
            f"{path}: without the outliers the graph falls into {parts} parts (before {before})",
            IncompleteWarning,
            stacklevel=3,
        )
    return WithoutOutliers(item, kept)

"""Residuals of the edges that a robust loss has kept: those of wrong edges say nothing of a fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.solving.solved import Solved


def kept_degrees(solution: Solved) -> NDArray[np.float64]:
    """(k,) residual angles of the edges that are no outliers; of all where nothing is left."""
    degrees = np.degrees(solution.residual_angles)
    if solution.robust is None:
        return degrees
    kept = degrees[~solution.is_outlier]
    return kept if len(kept) > 0 else degrees


def median_high_largest(solution: Solved) -> tuple[float, float, float]:
    """Of these the median, what 95 % are below, and the largest, degrees."""
    degrees = kept_degrees(solution)
    median, high = np.percentile(degrees, [50, 95])
    return float(median), float(high), float(degrees.max())

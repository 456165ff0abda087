"""Angles of poses in files, headings or roll, pitch and yaw, that look like degrees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.units import QUESTION, beyond_a_turn


def angle_notes(angles: NDArray[np.float64], places: Sequence[object]) -> tuple[str, ...]:
    """A note where some of the angles (m, k) of measurements are larger than they can be.

    Args:
        angles: as if in radians.
        places: (m,) where each row stands: the number of a line, or a name.
    """
    if not len(angles):
        return ()
    odd = beyond_a_turn(np.abs(angles).max(axis=1), angles, ("angle", "angles"))
    if odd is None:
        return ()
    place = places[odd[0]]
    where = f"in line {place}" if isinstance(place, (int, np.integer)) else f"in {place}"
    return (f"{odd[1]}, first {where}: {QUESTION}",)

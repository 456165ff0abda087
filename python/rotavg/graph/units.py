"""Angles that look like degrees where radians are meant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.ids import IdArray

TURN = 2 * np.pi + 0.01  # radians: as far as any relative rotation turns, and rounding
QUESTION = "are they degrees? radians are expected"


def beyond_a_turn(
    sizes: NDArray[np.float64], numbers: NDArray[np.float64], names: tuple[str, str]
) -> tuple[int, str] | None:
    """The first of m angles that is larger than a full turn, and what to say; None if none is.

    Also where all numbers are whole, as angles in degrees often are, and some beyond half a turn.

    Args:
        sizes: (m,) angles of rotations, as if in radians, of any sign.
        numbers: (m, ...) what the angles come from.
        names: of one and of several of them.
    """
    far = np.abs(sizes) > TURN
    if far.any():
        count, what = int(far.sum()), "larger than a full turn"
    elif (np.abs(sizes) > np.pi).any() and (numbers == np.rint(numbers)).all() and len(sizes) > 1:
        far = np.abs(sizes) > np.pi
        count, what = int(far.sum()), "larger than half a turn, and all are whole numbers"
    else:
        return None
    verb = "is" if count == 1 else "are"
    some = f"{count} of {len(sizes)} {names[1]}" if len(sizes) > 1 else f"the {names[0]}"
    return int(np.argmax(far)), f"{some} {verb} {what} ({np.abs(sizes).max():.6g} at most)"


def note_of_degrees(edges: IdArray, rotvecs: NDArray[np.float64]) -> tuple[str, ...]:
    """A note where rotation vectors (m, 3) of edges (m, 2) look like degrees."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(rotvecs, axis=1)
    odd = beyond_a_turn(length, rotvecs, ("rotation vector", "rotation vectors"))
    if odd is None:
        return ()
    i, j = edges[odd[0]].tolist()
    return (f"{odd[1]}, first of edge ({i!r}, {j!r}): {QUESTION}",)

"""What a part keeps of the last rounds for Anderson's mixing of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.distributed.local import vee_difference
from rotavg.distributed.part import Part, Rotations
from rotavg.graph.conventions import matrices_from_rotvecs

HISTORY = 10  # rounds that the mixing looks back on: 24 bytes of a node each


@dataclass(frozen=True, eq=False)
class Past:
    """The last rounds of a part; its vectors are of single precision, as they only suggest.

    Attributes:
        now: (num_own, 3, 3) where G led last.
        steps: (k, num_own, 3) how far each round led, as rotation vectors to the third order.
        ends: (k, num_own, 3) from `now` to where each round led.
    """

    now: Rotations
    steps: NDArray[np.float32]
    ends: NDArray[np.float32]


def remembered(part: Part, past: Past | None, begin: Rotations, end: Rotations) -> Past:
    """With one round more, which led from one to the other."""
    step = _between(begin, end)[None]
    if past is None:
        return Past(end, step, np.zeros_like(step))
    back = _between(end, past.now)
    return Past(
        end,
        np.concatenate([past.steps, step])[-HISTORY:],
        np.concatenate([past.ends + back, np.zeros_like(step)])[-HISTORY:],
    )


def _between(here: Rotations, there: Rotations) -> NDArray[np.float32]:
    """Vectors v with exp([v]) R_here ~ R_there, to the third order."""
    return (0.5 * vee_difference(there @ here.transpose(0, 2, 1))).astype(np.float32)


def steps_gram(part: Part, past: Past) -> NDArray[np.float64]:
    """(k, k) products of the steps."""
    steps = past.steps.reshape(len(past.steps), -1).astype(np.float64)
    return steps @ steps.T


def mean(part: Part, past: Past, share: NDArray[np.float64]) -> Rotations:
    """Of where the rounds led, in these shares."""
    toward = np.tensordot(share, past.ends.astype(np.float64), axes=1)
    R = matrices_from_rotvecs(toward) @ past.now
    rotations: Rotations = _core.nearest_rotation(np.ascontiguousarray(R))
    return rotations

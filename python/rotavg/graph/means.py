"""The mean of rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.nearest import TOLERANCE, orthogonality_errors, why_no_rotation
from rotavg.graph.se3 import log_so3

_NEGLIGIBLE = 1e-14  # radians
_MAX_STEPS = 100


def karcher_mean(
    rotations: ArrayLike, start: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """The rotation (3, 3) of the least sum of squared angles to rotations (k, 3, 3).

    R <- R exp(mean of log(R^T R_k)) from `start` (3, 3), or the chordal mean (Hartley, Trumpf, Dai
    and Li 2013). It is the one mean where all of them lie within pi / 2 of it; of rotations further
    spread it is a local minimum.

    Raises GraphError for no rotations, or a matrix that is none.
    """
    given = np.asarray(rotations)
    R = as_floats(rotations, (len(given) if given.ndim else 0, 3, 3), "rotations")
    if len(R) == 0:
        raise GraphError("found no rotations, expected one at least")
    errors = orthogonality_errors(R)
    if not (errors <= TOLERANCE).all():
        k = int(np.argmin(errors <= TOLERANCE))
        raise GraphError(f"matrix {k} {why_no_rotation(R[k], errors[k], TOLERANCE)}")
    mean = _core.nearest_rotation(R.sum(axis=0)[None])[0] if start is None else start
    for _ in range(_MAX_STEPS):
        step = log_so3(mean.T @ R).mean(axis=0)
        mean = _core.nearest_rotation((mean @ matrices_from_rotvecs(step))[None])[0]
        if np.abs(step).max() <= _NEGLIGIBLE:
            break
    return np.asarray(mean)

"""Relative translations of the edges of a pose graph, where it has any."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import ReadOnly, as_floats, read_only
from rotavg.base.errors import GraphError


@dataclass(frozen=True, eq=False)
class RelativeTranslations(ReadOnly):
    """What was measured of the edges' translations; averaging rotations does not use them.

    Attributes:
        vectors: (m, 3) the position of j in the frame of i, for every edge (i, j).
        information: (m, 3, 3) inverse covariances of these, in the frame of j as measured, which is
            where g2o and GTSAM have them; symmetric and positive definite. The identity by default.

    Raises:
        GraphError: something else was given.
    """

    vectors: NDArray[np.float64]
    information: NDArray[np.float64]

    def __init__(self, vectors: ArrayLike, information: ArrayLike | None = None) -> None:
        m = len(vectors) if isinstance(vectors, (np.ndarray, list, tuple)) else 1
        t = as_floats(vectors, (m, 3), "translations")
        if information is None:
            information = np.broadcast_to(np.eye(3), (m, 3, 3))
        omega = as_floats(information, (m, 3, 3), "translation information")
        if not np.isfinite(t).all():
            edge = int(np.argmin(np.isfinite(t).all(axis=1)))
            raise GraphError(f"translation {edge} is {t[edge].tolist()}, expected finite numbers")
        bad = first_not_positive_definite(omega)
        if bad is not None:
            raise GraphError(f"translation information {bad} is not symmetric positive definite")
        object.__setattr__(self, "vectors", read_only(t))
        object.__setattr__(self, "information", read_only(omega))

    def __len__(self) -> int:
        return len(self.vectors)

    def select(self, edges: NDArray[np.bool_]) -> RelativeTranslations:
        """The translations of the edges (m,) marked True."""
        return RelativeTranslations(self.vectors[edges], self.information[edges])


def first_not_positive_definite(matrices: NDArray[np.float64]) -> int | None:
    """Row of the first of (m, 3, 3) that is not symmetric positive definite; None if all are."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 0, 2]
    d, e, f = matrices[:, 1, 1], matrices[:, 1, 2], matrices[:, 2, 2]
    scale = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(matrices - np.swapaxes(matrices, 1, 2)).max(axis=(1, 2), initial=0.0)
    with np.errstate(all="ignore"):
        a, b, c, d, e, f = (entry / scale for entry in (a, b, c, d, e, f))
        minor = a * d - b * b
        det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
        good = np.isfinite(scale) & (asymmetry <= 1e-9 * scale) & (a > 0) & (minor > 0) & (det > 0)
    return None if good.all() else int(np.argmin(good))

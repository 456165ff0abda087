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
        cross: (m, 3, 3) information that translation (rows) and rotation (columns) share, for
            `refine_poses`; None where there is none.
        dimension: 2 of a pose graph in the plane z = 0, all of whose rotations are about z; or 3.

    Raises:
        GraphError: something else was given.
    """

    vectors: NDArray[np.float64]
    information: NDArray[np.float64]
    cross: NDArray[np.float64] | None
    dimension: int

    def __init__(
        self,
        vectors: ArrayLike,
        information: ArrayLike | None = None,
        *,
        cross: ArrayLike | None = None,
        dimension: int = 3,
    ) -> None:
        rows = vectors.shape if isinstance(vectors, np.ndarray) else ()
        m = len(vectors) if isinstance(vectors, (list, tuple)) else rows[0] if rows else 1
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
        shared = None if cross is None else as_floats(cross, (m, 3, 3), "cross information")
        if shared is not None and not np.isfinite(shared).all():
            edge = int(np.argmin(np.isfinite(shared).all(axis=(1, 2))))
            raise GraphError(f"cross information {edge} holds a NaN or an infinity")
        if dimension not in (2, 3):
            raise GraphError(f"the dimension of translations is {dimension!r}, expected 2 or 3")
        if dimension == 2 and t[:, 2].any():
            edge = int(np.argmax(t[:, 2] != 0))
            raise GraphError(f"translation {edge} is {t[edge].tolist()}, expected one in the plane")
        object.__setattr__(self, "vectors", read_only(t))
        object.__setattr__(self, "information", read_only(omega))
        object.__setattr__(self, "cross", None if shared is None else read_only(shared))
        object.__setattr__(self, "dimension", dimension)

    def __len__(self) -> int:
        return len(self.vectors)

    def select(self, edges: NDArray[np.bool_]) -> RelativeTranslations:
        """The translations of the edges (m,) marked True."""
        return RelativeTranslations(
            self.vectors[edges],
            self.information[edges],
            cross=None if self.cross is None else self.cross[edges],
            dimension=self.dimension,
        )


def first_not_positive_definite(matrices: NDArray[np.float64]) -> int | None:
    """Row of the first of (m, 3, 3) that is not symmetric positive definite; None if all are."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 0, 2]
    d, e, f = matrices[:, 1, 1], matrices[:, 1, 2], matrices[:, 2, 2]
    scale = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    with np.errstate(all="ignore"):  # there may be infinities among them
        asymmetry = np.abs(matrices - np.swapaxes(matrices, 1, 2)).max(axis=(1, 2), initial=0.0)
        a, b, c, d, e, f = (entry / scale for entry in (a, b, c, d, e, f))
        minor = a * d - b * b
        det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
        good = np.isfinite(scale) & (asymmetry <= 1e-9 * scale) & (a > 0) & (minor > 0) & (det > 0)
    return None if good.all() else int(np.argmin(good))
